"""A folder of results holds folders and regular files alone: what is written, replaced, removed or read in it must not reach files
elsewhere, nor wait for a pipe or a device. Whoever packed it, a workspace or a solved drive, may be a stranger."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from unveil_core.base.disk.open_safely import RefusedFileError, check_one_name, is_link
from unveil_core.base.errors import WorkspaceError

__all__ = ["EVENTS", "LOCK", "refuse_links"]

LOCK, EVENTS = ".lock", "events.jsonl"
"""The files that are written in place: of them no other name may be anywhere."""


def refuse_links(root: Path) -> None:
    """Check a folder of results before anything in it is read or written; the folder itself may be reached through a link.

    One look at each folder, none at a file: a workspace of 10,000 files takes some hundredths of a second.

    Raises:
        WorkspaceError: it holds a symbolic link, a pipe or a device; or a file that is written in place has another name.
    """
    folders = [os.fspath(root)]
    while folders:
        folder = folders.pop()
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    _check(entry, folders)
        except (FileNotFoundError, NotADirectoryError):
            continue  # a run that goes on has removed it in this moment
        except OSError as error:
            raise WorkspaceError(
                f"cannot be read: {error.strerror}", path=folder, mend="make the folder readable"
            ) from error
    for name in (LOCK, EVENTS):
        path = root / name
        with suppress(FileNotFoundError):
            try:
                check_one_name(path, os.lstat(path))
            except RefusedFileError as error:
                raise WorkspaceError(str(error.strerror), path=path, mend="put a copy in its place") from error


def _check(entry: os.DirEntry[str], folders: list[str]) -> None:
    if entry.is_symlink() or (os.name == "nt" and is_link(entry.stat(follow_symlinks=False))):
        raise WorkspaceError(
            "A symbolic link: what is read or written through it may lie anywhere",
            path=entry.path,
            mend="put the file or folder itself there, or link the whole folder",
        )
    if entry.is_dir(follow_symlinks=False):
        folders.append(entry.path)
    elif not entry.is_file(follow_symlinks=False) and os.path.lexists(entry.path):
        raise WorkspaceError(
            "Not a file but a pipe or a device", path=entry.path, mend="remove it, or put a file in its place"
        )
