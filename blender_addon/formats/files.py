# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing files whole or not at all, and errors of files in one line. No bpy here."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

__all__ = ["link_or_copy", "one_line", "own_folder", "write_whole"]


def own_folder(workspace: Path, *names: str) -> Path:
    """A folder of the add-on's in a workspace, made if need be; never one that a link leads to elsewhere: what is written and
    removed there would be somebody's.

    Raises:
        OSError: it cannot be made, or is a link.
    """
    folder = workspace
    for name in names:
        folder = folder / name
        folder.mkdir(parents=True, exist_ok=True)
        if folder.is_symlink() or os.path.realpath(folder) != os.path.join(
            os.path.realpath(folder.parent), folder.name
        ):
            raise OSError(
                errno.ELOOP, "is a link, and files would be written through it (remove the link)", str(folder)
            )
    return folder


def write_whole(path: Path, content: bytes) -> None:
    """Write a file under another name and rename it: on a full disk nothing is left of it, and the old one stays.

    Raises:
        OSError: it cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    partial.unlink(missing_ok=True)  # not to be written through, if it is a link
    try:
        with partial.open("xb") as file:
            file.write(content)
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def link_or_copy(source: Path, target: Path) -> None:
    """Make ``target`` the same file as ``source``, a copy of it where the file system has no links.

    Raises:
        OSError: neither can be made.
    """
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
        return
    except OSError:
        pass
    partial = target.with_name(f".{target.name}.partial")
    partial.unlink(missing_ok=True)
    try:
        shutil.copy2(source, partial)
        os.replace(partial, target)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def one_line(error: Exception, place: str | Path) -> str:
    """What went wrong, for people.

    Args:
        error: of a file or its content; an error of the second kind names the file itself.
        place: what was read or written, for errors of the first kind that name none.
    """
    if isinstance(error, OSError):
        where = error.filename or place
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return f"{where}: the disk is full (free some space and try again)"
        return f"{where}: {error.strerror or error}"
    return " ".join(str(error).split())
