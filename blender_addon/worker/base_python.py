# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python that an environment is made with, its base: which one, a copy of Blender's own, and whether it is gone. No bpy here.

A virtual environment has no standard library: it borrows that of its base, and does not start without it. A system's Python
outlives Blender; Blender's own goes when Blender is updated or moved, so it is copied. The file is also the program that does that,
run by the Python that is to be copied:

    python base_python.py FOLDER
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Collection, Mapping
from pathlib import Path

__all__ = ["base_python", "copy_base", "lies_in", "lost_base", "on_path"]

MINORS = (11, 12, 13)
"""Versions of Python 3 that torch and numba are built for."""


def base_python(own: str, environ: Mapping[str, str] | None = None, minors: Collection[int] = MINORS) -> str | None:
    """A Python of a version that the environment can have and that can make one: one of the system's, else Blender's own.

    Blender's own comes last, for it goes when Blender is updated or moved.

    Args:
        own: the interpreter of this process.
        environ: whose PATH is looked at; the process's own by default.
        minors: the versions that will do, 11 for 3.11: wheels in a folder are built for one.
    """
    environ = os.environ if environ is None else environ
    minors = [minor for minor in MINORS if minor in minors]
    names = [on_path(f"python3.{minor}", environ) for minor in minors] + [on_path("python3", environ)]
    for python in (*names, *(_installed(minor, environ) for minor in minors), own):
        if python and _can_make(python, minors):
            return python
    return None


def _installed(minor: int, environ: Mapping[str, str]) -> str | None:
    """Where installers put a Python: on macOS and Windows a program that was not started from a terminal has a short path."""
    if sys.platform == "darwin":
        places = [
            Path(f"/opt/homebrew/bin/python3.{minor}"),
            Path(f"/usr/local/bin/python3.{minor}"),
            Path(f"/Library/Frameworks/Python.framework/Versions/3.{minor}/bin/python3.{minor}"),
        ]
    elif os.name == "nt":
        roots = [(environ.get("LOCALAPPDATA"), "Programs/Python"), (environ.get("PROGRAMFILES"), "")]
        places = [Path(root) / inner / f"Python3{minor}/python.exe" for root, inner in roots if root]
    else:
        return None
    return next((str(place) for place in places if place.is_file()), None)


def lost_base(folder: Path) -> str:
    """Where the Python lay that a virtual environment was made with, if it is gone; else an empty string.

    ``pyvenv.cfg`` tells where it lay. Whatever an environment has installed needs that Python to run.
    """
    try:
        said = (folder / "pyvenv.cfg").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    home = re.search(r"^home\s*=\s*(.+?)\s*$", said, re.MULTILINE)
    if home is None or any(Path(home.group(1)).glob("python*")):
        return ""
    return home.group(1)


def on_path(name: str, environ: Mapping[str, str]) -> str | None:
    """A program in one of the path's folders. Never one in the working folder, where Windows looks first: who opens a .blend works
    where it lies."""
    folders = [folder for folder in environ.get("PATH", "").split(os.pathsep) if os.path.isabs(folder)]
    return next((found for folder in folders if (found := shutil.which(os.path.join(folder, name)))), None)


def _can_make(python: str, minors: Collection[int] = MINORS) -> bool:
    program = "import ensurepip, sys, venv; print(*sys.version_info[:2])"
    try:
        done = subprocess.run([python, "-I", "-c", program], capture_output=True, text=True, timeout=20)
        major, minor = (int(n) for n in done.stdout.split())
        return major == 3 and minor in minors
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return False


LEFT_OUT = (
    "site-packages",
    "__pycache__",
    "test",
    "tests",
    "idlelib",
    "include",
    "share",
    "pkgconfig",
    "*.a",
    "config-*",
)
"""Names that are not copied: installed packages, tests, headers. What environments read stays, ``ensurepip`` too."""


def copy_base(folder: Path) -> Path:
    """Copy the Python that runs this into a folder that is not there yet.

    Returns:
        the interpreter of the copy.
    Raises:
        OSError: it lies in no folder of its own, as a system's, cannot be copied, or the copy makes no environments.
    """
    prefix, executable = Path(sys.base_prefix).resolve(), Path(sys.executable).resolve()
    if not executable.is_relative_to(prefix) or str(prefix) in ("/usr", "/usr/local"):
        raise OSError(f"{executable} does not lie in a folder of its own, and is not copied")
    shutil.copytree(prefix, folder, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_OUT))
    copy = folder / executable.relative_to(prefix)
    if not _can_make(str(copy)):
        raise OSError(f"the copy of {executable} makes no environments")
    return copy


def lies_in(python: str, folder: str) -> bool:
    """Whether an interpreter lies in a folder, as Blender's own does in Blender's."""
    return bool(python and folder) and Path(python).resolve().is_relative_to(Path(folder).resolve())


if __name__ == "__main__":
    try:
        print(copy_base(Path(sys.argv[1])), flush=True)
    except OSError as error:  # shutil's own, too
        raise SystemExit(f"the base could not be copied: {error}") from error
