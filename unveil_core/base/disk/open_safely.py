"""The one way to open what lies in drives and workspaces, which may come from a stranger.

Regular files alone: a pipe or a device may never answer, or never end. Nothing is waited for, and no file is read that is larger
than any of its kind. In a drive a symbolic link may name a photograph anywhere on the disk; in a workspace none is followed
(:mod:`unveil_core.base.disk.links` looks at all of it), and what is written in place has no second name.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

__all__ = [
    "LARGEST_FILE",
    "LARGEST_STATE",
    "LARGEST_TEXT",
    "RefusedFileError",
    "check_file",
    "check_one_name",
    "is_link",
    "open_file",
    "open_in_place",
    "read_bytes",
]

LARGEST_FILE = 1 << 30
"""Bytes of a file that is read as a whole, a picture or a sweep: hundred times the usual."""
LARGEST_TEXT = 1 << 28
"""Bytes of a text of a drive, as its JSON: 250,000 frames of nerfstudio."""
LARGEST_STATE = 1 << 26
"""Bytes of what a workspace says of itself: hundred times that of the longest drives."""
BESIDE = (
    getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
)
"""Flags of each opening: none waits for somebody at the other end, and bytes are bytes on Windows, too."""
NOFOLLOW: int = getattr(os, "O_NOFOLLOW", 0)
"""Zero on Windows, where the path is looked at before it is opened."""
JUNCTION = 0xA0000003
"""Windows' mark of a folder that leads to another one without being a symbolic link."""


class RefusedFileError(OSError):
    """A file that is not opened, because of what it is; ``strerror`` says why."""


def open_file(path: Path | str, most: int | None = None, *, links: bool = True) -> BinaryIO:
    """Open a regular file to be read.

    Args:
        most: bytes that it has at most; None = any number, for who reads it piece by piece.
        links: whether a symbolic link at the end of the path is followed.
    Raises:
        RefusedFileError: it is no regular file, or too large, or a link that is not to be followed.
        OSError: it is not there, is a folder, or cannot be read.
    """
    _check_kind(path, os.stat(path, follow_symlinks=links))
    try:
        handle = os.open(path, os.O_RDONLY | BESIDE | (0 if links else NOFOLLOW))
    except OSError as error:
        raise _of_link(path, error) from error
    try:
        found = os.fstat(handle)
        _check_kind(path, found)
        if most is not None and found.st_size > most:
            raise _too_large(path, most)
        if BESIDE & getattr(os, "O_NONBLOCK", 0):
            os.set_blocking(handle, True)  # the flag was for the opening alone
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: Path | str, most: int = LARGEST_FILE, *, links: bool = True) -> bytes:
    """All that a regular file holds.

    Args:
        most: bytes; links: see :func:`open_file`.
    Raises:
        OSError: see :func:`open_file`.
    """
    with open_file(path, most, links=links) as stream:
        # Some files of the system say that they are empty, and go on for ever.
        content = stream.read(min(os.fstat(stream.fileno()).st_size, most) + 1)
        parts = [content]
        held = len(content)
        while parts[-1] and held <= most:
            parts.append(stream.read(min(1 << 20, most + 1 - held)))
            held += len(parts[-1])
        if held > most:
            raise _too_large(path, most)
        return content if held == len(content) else b"".join(parts)


def check_file(path: Path | str, most: int | None = None) -> None:
    """Check a file before a library opens its path by itself: see :func:`open_file`.

    Raises:
        OSError: see :func:`open_file`.
    """
    open_file(path, most).close()


def open_in_place(path: Path | str, flags: int) -> int:
    """Handle of a file that is written in place: of one that has this name alone, for another would be written with it.

    Args:
        flags: of :func:`os.open`; with ``O_CREAT`` it is made where it is not there.
    Raises:
        RefusedFileError: it is no regular file, or has another name: a symbolic or a hard link.
        OSError: it cannot be opened.
    """
    try:
        found = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    else:
        _check_kind(path, found)
        check_one_name(path, found)
    try:
        handle = os.open(path, flags | BESIDE | NOFOLLOW, 0o666)
    except OSError as error:
        raise _of_link(path, error) from error
    try:
        found = os.fstat(handle)
        _check_kind(path, found)
        check_one_name(path, found)
    except BaseException:
        os.close(handle)
        raise
    return handle


def is_link(found: os.stat_result) -> bool:
    """Whether what a path names, looked at without following it, leads elsewhere: a symbolic link, or a junction of Windows."""
    return stat.S_ISLNK(found.st_mode) or getattr(found, "st_reparse_tag", 0) == JUNCTION


def check_one_name(path: Path | str, found: os.stat_result) -> None:
    """Raise a RefusedFileError where a file has a second name; folders have several."""
    if stat.S_ISREG(found.st_mode) and found.st_nlink > 1:
        raise RefusedFileError(
            errno.EMLINK, "it is a hard link, and what is written to it would be written elsewhere, too", str(path)
        )


def _check_kind(path: Path | str, found: os.stat_result) -> None:
    if is_link(found):
        raise RefusedFileError(errno.ELOOP, "it is a symbolic link", str(path))
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise RefusedFileError(errno.EINVAL, "not a file but a pipe or a device", str(path))


def _of_link(path: Path | str, error: OSError) -> OSError:
    """What the system says of a link that it does not follow, as everything else here says it."""
    if error.errno == errno.ELOOP:
        return RefusedFileError(errno.ELOOP, "it is a symbolic link", str(path))
    return error


def _too_large(path: Path | str, most: int) -> RefusedFileError:
    return RefusedFileError(errno.EINVAL, f"it is larger than {most:,} bytes, which no such file is", str(path))
