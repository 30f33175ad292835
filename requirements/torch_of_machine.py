"""Install the torch of the lock: on Linux without CUDA, from PyTorch's own index, elsewhere by the hashes of the lock.

    python requirements/torch_of_machine.py

For machines that only test: CUDA's libraries are gigabytes, which a machine without a card has no use for.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
WITHOUT_CUDA = "https://download.pytorch.org/whl/cpu"


def command(system: str) -> list[str]:
    """The call of pip on a system, as ``sys.platform`` names it."""
    lock = HERE / "torch.txt"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    if not system.startswith("linux"):
        return [*pip, "--require-hashes", "-r", str(lock)]
    version = re.search(r"^torch==([^\s;]+)", lock.read_text(encoding="utf-8"), re.MULTILINE)
    assert version is not None
    return [*pip, "--index-url", WITHOUT_CUDA, f"torch=={version.group(1)}"]


if __name__ == "__main__":
    raise SystemExit(subprocess.run(command(sys.platform)).returncode)
