"""Wheels small enough to be installed in a test, and what the extension brings beside that of unveil_core."""

from __future__ import annotations

import base64
import hashlib
import zipfile
from pathlib import Path

from blender_addon.worker.environment import HASH, LOCKS


def tiny_wheel(
    folder: Path,
    module: str = '__version__ = "0.1.0"\n',
    name: str = "unveil_core",
    version: str = "0.1.0",
    requires: tuple[str, ...] = (),
) -> Path:
    """A wheel that has nothing but one ``__init__.py``."""
    folder.mkdir(parents=True, exist_ok=True)
    info = f"{name}-{version}.dist-info"
    needs = "".join(f"Requires-Dist: {line}\n" for line in requires)
    files = {
        f"{name}/__init__.py": module,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: {version}\n{needs}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    path = folder / f"{name}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        record = ""
        for file, text in files.items():
            wheel.writestr(file, text)
            digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()
            record += f"{file},sha256={digest},{len(text)}\n"
        wheel.writestr(f"{info}/RECORD", record + f"{info}/RECORD,,\n")
    return path


def locked(*wheels: Path) -> str:
    """A lock file that has these wheels."""
    return "".join(
        f"{name}=={version} --hash=sha256:{digest(path)}\n"
        for path in wheels
        for name, version in [path.name.split("-")[:2]]
    )


def digest(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def tiny_core(addon: Path, **locks: str) -> Path:
    """An add-on's ``core/``, as `make extension` fills it: a wheel of unveil_core, its hash, and lock files, empty unless given."""
    wheel = tiny_wheel(
        addon / "core",
        "import street_shapes\n__version__ = '0.1.0'\n" if "core" in locks else "__version__ = '0.1.0'\n",
    )
    locks.setdefault("pip", f"pip==99.0 --hash=sha256:{64 * '0'}\n")  # is nowhere: the one that is there does
    for name in LOCKS:
        (wheel.parent / name).write_text(locks.get(name.removesuffix(".txt"), ""))
    (wheel.parent / HASH).write_text(f"{wheel.name}:\n--hash=sha256:{digest(wheel)}\n")
    return wheel
