"""A workspace holds no symbolic links: what is written, replaced or removed in it must not reach files elsewhere."""

from __future__ import annotations

import os
from pathlib import Path

from unveil_core.base.errors import WorkspaceError

__all__ = ["refuse_links"]


def refuse_links(root: Path) -> None:
    """Check a workspace before a run writes in it; the workspace itself may be reached through a link.

    Raises:
        WorkspaceError: it holds a symbolic link.
    """
    folders = [os.fspath(root)]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_symlink():
                    raise WorkspaceError(
                        "is a symbolic link, and a run would write through it",
                        path=entry.path,
                        mend="put the file or folder itself there, or link the whole workspace",
                    )
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
