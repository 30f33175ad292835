"""Programs that are started by name: never one that lies in the working folder."""

from __future__ import annotations

import os
import shutil

__all__ = ["program"]


def program(name: str) -> str | None:
    """The path of a program in an absolute folder of ``PATH``; None = none. Windows would look in the working folder first."""
    file = f"{name}.exe" if os.name == "nt" else name
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        if os.path.isabs(folder) and (found := shutil.which(os.path.join(folder, file))):
            return found
    return None
