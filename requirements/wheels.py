"""Fill a folder with the wheels that the add-on's environment is made of, for a machine without a network.

    make wheels FOLDER=folder [TORCH_INDEX=URL] [PYTHON=python3.12] [FOR="--platform win_amd64"]

In the add-on's preferences the folder is named as *Folder of wheels*. Every file but torch's has a hash in the lock files; a torch
of an index of its own (PyTorch's has builds without CUDA) has the version of the lock. The wheels are for the version of the
Python that make runs: ``PYTHON=python3.12`` names another. ``FOR`` takes pip's options for another system than this one.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
STRICT = ("--require-hashes", "--no-deps")


def download(folder: Path, torch_index: str, machine: list[str]) -> None:
    """Fetch the wheels.

    Args:
        folder: where to; made where it is not there.
        torch_index: package index for torch; empty: the usual one, and CUDA's libraries with it where the machine has Linux.
        machine: pip's options for another machine.
    Raises:
        SystemExit: pip failed; it has said why.
    """
    command = [sys.executable, "-m", "pip", "download", "--only-binary", ":all:", "--dest", str(folder), *machine]
    locks = [f"--requirement={HERE / name}.txt" for name in ("pip", "core", "solve")]
    if torch_index:
        locked = re.search(r"^torch==[^\s;]+", (HERE / "torch.txt").read_text(), re.MULTILINE)
        assert locked is not None
        _run([*command, *STRICT, *locks])
        _run([*command, "--no-deps", "--index-url", torch_index, locked.group()])
    else:
        elsewhere = any(
            word.startswith(("win", "macosx")) for word in machine
        )  # pip heeds the lock's "on Linux" by where it runs
        torch = ("torch",) if elsewhere else ("torch", "cuda")
        _run([*command, *STRICT, *locks, *(f"--requirement={HERE / name}.txt" for name in torch)])


def _run(command: list[str]) -> None:
    if subprocess.run(command).returncode:
        raise SystemExit("The folder is not complete: see what pip says above")


def main(arguments: list[str]) -> None:
    """The folder, the index for torch and pip's options, as make gives them; the latter two may be empty."""
    if len(arguments) != 3 or not arguments[0]:
        raise SystemExit('make wheels FOLDER=folder [TORCH_INDEX=URL] [FOR="…"]')
    folder = Path(arguments[0]).expanduser()
    download(folder, arguments[1], shlex.split(arguments[2]))
    files = list(folder.glob("*.whl"))
    print(f"{folder.absolute()}: {len(files)} wheels, {sum(f.stat().st_size for f in files) / 1e6:.0f} MB")


if __name__ == "__main__":
    main(sys.argv[1:])
