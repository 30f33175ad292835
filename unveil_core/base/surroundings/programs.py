"""Programs that are started: none that lies in the working folder, and none that loads libraries from there."""

from __future__ import annotations

import os
import shutil

__all__ = ["environment", "program"]


def environment(**more: str) -> dict[str, str]:
    """That of a program which is started: this process's, and more variables.

    Without the empty entry of ``LD_LIBRARY_PATH`` that OpenCV makes when it is imported, and that stands for the working folder:
    where this is a library in another program, nobody has kept it from that (see ``guarded_imports``).
    """
    found = {**os.environ, **more}
    folders = [folder for folder in found.pop("LD_LIBRARY_PATH", "").split(os.pathsep) if folder]
    return found | ({"LD_LIBRARY_PATH": os.pathsep.join(folders)} if folders else {})


def program(name: str) -> str | None:
    """The path of a program in an absolute folder of ``PATH``; None = none. Windows would look in the working folder first."""
    file = f"{name}.exe" if os.name == "nt" else name
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        if os.path.isabs(folder) and (found := shutil.which(os.path.join(folder, file))):
            return found
    return None
