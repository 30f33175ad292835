# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing files whole or not at all, and errors of files in one line. No bpy here."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

__all__ = ["link_or_copy", "one_line", "write_whole"]


LONGEST_LINE = 800


def write_whole(path: Path, content: bytes) -> None:
    """Write a file under another name and rename it: on a full disk nothing is left of it, and the old one stays.

    Raises:
        OSError: it cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(content)
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
        return _shown(f"{where}: {error.strerror or error}")
    return _shown(str(error))


def _shown(text: str) -> str:
    """One line that Blender can show: text of files may hold anything."""
    whole = " ".join(text.split())
    whole = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in whole)
    return whole if len(whole) <= LONGEST_LINE else f"{whole[:LONGEST_LINE]}…"
