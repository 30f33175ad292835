# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing files whole or not at all, and errors of files in one line. No bpy here."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from .open_safely import LARGEST_PICTURE, LARGEST_STATE, open_file, read_bytes

__all__ = [
    "copied",
    "discard",
    "file_stamp",
    "files_stamp",
    "free_name",
    "is_link",
    "make_own",
    "move",
    "one_line",
    "own_folder",
    "patiently",
    "readable_as",
    "set_time_of",
    "shown",
    "write_changed",
    "write_whole",
]

HELD = (5, 32)
"""Windows' numbers of what a rename meets while a virus scanner or a viewer holds the file: access denied, sharing violation."""
WAITS_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.3)
"""Between attempts, seconds: one in all, after which it is no passing look."""
FICLONE = 0x40049409
"""Linux' request to share a file's blocks with another one."""
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


def discard(path: Path) -> None:
    """Remove a file, where it is there; see :func:`patiently`."""
    with suppress(FileNotFoundError):
        patiently(path.unlink)


def file_stamp(path: str | Path) -> str:
    """Size and time of a file, which change when it is written anew; empty where it is not there, or a pipe or a device."""
    try:
        found = os.stat(path)
    except OSError:
        return ""
    return f"{found.st_size} {found.st_mtime_ns}" if stat.S_ISREG(found.st_mode) else ""


def files_stamp(paths: Iterable[str | Path]) -> str:
    """The same of many files, in few characters."""
    return hashlib.sha256("\n".join(file_stamp(path) for path in paths).encode()).hexdigest()[:32]


def _partial(path: Path) -> Path:
    """A temporary name of a file: not much longer than a name may be, and nobody else's, as of another Blender."""
    encoded = path.name.encode(errors="surrogateescape")[:LONGEST_START]
    return path.with_name(f".{encoded.decode(errors='ignore')}.{secrets.token_hex(6)}.partial")


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
        if is_link(folder):
            raise OSError(
                errno.ELOOP, "is a link, and files would be written through it (remove the link)", str(folder)
            )
    return folder


def is_link(path: Path) -> bool:
    """Whether a path leads elsewhere: a symbolic link, or a junction of Windows."""
    return path.is_symlink() or os.path.realpath(path) != os.path.join(os.path.realpath(path.parent), path.name)


LONGEST_LINE = 800


def write_whole(path: Path, content: bytes, *, like: Path | None = None) -> None:
    """Write a file under another name and rename it: on a full disk nothing is left of it, and the old one stays.

    Args:
        like: what it is a copy of: who may not read that may not read this either.
    Raises:
        OSError: it cannot be written.
    """
    partial = _partial(path)
    try:
        with _new(partial, like) as file:
            file.write(content)
        move(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _new(path: Path, like: Path | None) -> BinaryIO:
    """A new file, never one that a link leads to; ``like``: see :func:`write_whole`."""
    rights = 0o666 if like is None else stat.S_IMODE(os.stat(like).st_mode) & 0o666 | 0o600
    return open(path, "xb", opener=lambda name, flags: os.open(name, flags, rights))


def readable_as(path: Path, like: Path) -> None:
    """Take the right to read a file from all who may not read the one that it shows.

    Raises:
        OSError: it is another user's.
    """
    rights = stat.S_IMODE(os.stat(like).st_mode) | 0o600
    os.chmod(path, stat.S_IMODE(os.stat(path).st_mode) & rights)


def set_time_of(path: Path, other: Path) -> None:
    """Give a file the time of the one that it is made of.

    Raises:
        OSError: times cannot be set there.
    """
    times = other.stat()
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def write_changed(path: Path, content: bytes) -> None:
    """The same where the file holds something else: whoever compares times finds nothing new."""
    with suppress(OSError):  # what cannot be read is replaced
        if read_bytes(path, max(len(content), LARGEST_STATE)) == content:
            return
    write_whole(path, content)


def make_own(path: Path) -> None:
    """Make sure that writing into a file changes no other: where it has a second name, a copy takes its place.

    Raises:
        OSError: it is not there, is a link or no regular file, or cannot be copied.
    """
    with open_file(path, LARGEST_PICTURE) as file:
        if os.fstat(file.fileno()).st_nlink > 1:
            write_whole(path, file.read(), like=path)


def copied(source: Path, target: Path) -> None:
    """Make ``target`` a copy of ``source`` with its time, never the same file: whoever paints on what Blender shows and saves it
    would write in the original. Where the file system can, the two share their blocks until one is written.

    Raises:
        OSError: it cannot be made.
    """
    partial = _partial(target)
    try:
        with open_file(source, LARGEST_PICTURE) as content, _new(partial, source) as stream:
            if not _cloned(content.fileno(), stream.fileno()):
                shutil.copyfileobj(content, stream, 1 << 20)
        set_time_of(partial, source)
        move(partial, target)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def free_name(path: Path, end: str) -> Path:
    """A name beside a file that nothing has: ``03_painted.png``, else ``03_painted_2.png`` and so on."""
    free, number = path.with_name(f"{path.stem}{end}{path.suffix}"), 1
    while os.path.lexists(free):
        number += 1
        free = path.with_name(f"{path.stem}{end}_{number}{path.suffix}")
    return free


def _cloned(source: int, target: int) -> bool:
    """Share the blocks of one open file with another, empty one, where system and file system can."""
    if sys.platform != "linux":
        return False
    import fcntl

    try:
        fcntl.ioctl(target, FICLONE, source)
    except OSError:
        return False
    return True


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
