"""A wheel of unveil_core small enough to be installed in a test."""

from __future__ import annotations

import base64
import hashlib
import zipfile
from pathlib import Path


def tiny_wheel(folder: Path, module: str = '__version__ = "0.1.0"\n') -> Path:
    """A wheel that has nothing but unveil_core/__init__.py."""
    folder.mkdir(parents=True, exist_ok=True)
    name, info = "unveil_core-0.1.0", "unveil_core-0.1.0.dist-info"
    files = {
        "unveil_core/__init__.py": module,
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: unveil-core\nVersion: 0.1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    path = folder / f"{name}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        record = ""
        for file, text in files.items():
            wheel.writestr(file, text)
            digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()
            record += f"{file},sha256={digest},{len(text)}\n"
        wheel.writestr(f"{info}/RECORD", record + f"{info}/RECORD,,\n")
    return path
