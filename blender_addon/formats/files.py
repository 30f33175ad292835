# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing files whole or not at all, and errors of files in one line. No bpy here."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterable
from pathlib import Path

__all__ = [
    "file_stamp",
    "files_stamp",
    "link_or_copy",
    "move",
    "one_line",
    "own_folder",
    "patiently",
    "shown",
    "write_changed",
    "write_whole",
]

HELD = (5, 32)
"""Windows' numbers of what a rename meets while a virus scanner or a viewer holds the file: access denied, sharing violation."""
WAITS_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.3)
"""Between attempts, seconds: one in all, after which it is no passing look."""
LONGEST_START = 100
"""Of a file's name, bytes that its temporary name begins with."""


def patiently(act: Callable[..., object], *arguments: object) -> None:
    """Rename or remove something; where another program holds it for a moment (Windows), do it again for about a second.

    Raises:
        OSError: it cannot be done; or it is still held.
    """
    for wait in WAITS_S:
        try:
            act(*arguments)
            return
        except PermissionError as error:
            if getattr(error, "winerror", None) not in HELD:
                raise
        time.sleep(wait)
    act(*arguments)


def move(source: Path, target: Path) -> None:
    """Rename a file, in the place of another one; see :func:`patiently`."""
    patiently(os.replace, source, target)


def file_stamp(path: str | Path) -> str:
    """Size and time of a file, which change when it is written anew; empty where it is not there."""
    try:
        stat = os.stat(path)
    except OSError:
        return ""
    return f"{stat.st_size} {stat.st_mtime_ns}"


def files_stamp(paths: Iterable[str | Path]) -> str:
    """The same of many files, in few characters."""
    return hashlib.sha256("\n".join(file_stamp(path) for path in paths).encode()).hexdigest()[:32]


def _partial(path: Path) -> Path:
    """The temporary name of a file: not much longer than a name may be."""
    encoded = path.name.encode(errors="surrogateescape")[:LONGEST_START]
    return path.with_name(f".{encoded.decode(errors='ignore')}.partial")


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


LONGEST_LINE = 800


def write_whole(path: Path, content: bytes) -> None:
    """Write a file under another name and rename it: on a full disk nothing is left of it, and the old one stays.

    Raises:
        OSError: it cannot be written.
    """
    partial = _partial(path)
    partial.unlink(missing_ok=True)  # not to be written through, if it is a link
    try:
        with partial.open("xb") as file:
            file.write(content)
        move(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def write_changed(path: Path, content: bytes) -> None:
    """The same where the file holds something else: whoever compares times finds nothing new."""
    if not path.is_file() or path.read_bytes() != content:
        write_whole(path, content)


def link_or_copy(source: Path, target: Path) -> None:
    """Make ``target`` the same file as ``source``, a copy of it where the file system has no links.

    Raises:
        OSError: neither can be made.
    """
    patiently(target.unlink, True)
    try:
        os.link(source, target)
        return
    except OSError:
        pass
    partial = _partial(target)
    partial.unlink(missing_ok=True)
    try:
        shutil.copy2(source, partial)
        move(partial, target)
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
            return shown(f"{where}: the disk is full (free some space and try again)")
        return shown(f"{where}: {error.strerror or error}")
    return shown(str(error))


def shown(text: str) -> str:
    """One line that Blender can show: text of files may hold anything."""
    whole = " ".join(text.split())
    whole = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in whole)
    return whole if len(whole) <= LONGEST_LINE else f"{whole[:LONGEST_LINE]}…"
