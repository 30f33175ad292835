# SPDX-License-Identifier: GPL-3.0-or-later
"""The one way to open the files of a workspace, which may come from a stranger. No bpy here.

Regular files alone, no link followed, nothing waited for, as large as such a file is at most: a pipe in a workspace would stop
Blender for good, and a device fill its memory, with the artist's work unsaved.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

__all__ = [
    "LARGEST_PICTURE",
    "LARGEST_SCENE",
    "LARGEST_STATE",
    "LARGEST_TEXT",
    "open_file",
    "json_in",
    "read_bytes",
    "refuse_links",
]

LARGEST_STATE, LARGEST_TEXT, LARGEST_PICTURE, LARGEST_SCENE = 1 << 26, 1 << 28, 1 << 30, 1 << 32
"""Bytes of what a workspace says of itself, of a list of frames or objects, of a picture, of a cloud or a mesh: hundred times
those of the longest drives."""
BESIDE = (
    getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
)
"""Flags of each opening: none waits for somebody at the other end, and bytes are bytes on Windows, too."""
NOFOLLOW = getattr(os, "O_NOFOLLOW", 0)
"""Zero on Windows, where the path is looked at before it is opened."""
MOST_JSON = 1 << 21
"""Values of a JSON text, as for the command. The poses and names of 20,000 photographs are a third of it."""
JUNCTION = 0xA0000003
"""Windows' mark of a folder that leads to another one without being a symbolic link."""


def open_file(path: str | Path, most: int, flags: int = os.O_RDONLY) -> BinaryIO:
    """Open a regular file.

    Args:
        most: bytes that it has at most.
        flags: of ``os.open``: to be read, or with ``O_RDWR`` to be read and written.
    Raises:
        OSError: it is not there, a link, no regular file or too large, or cannot be opened; ``strerror`` says which.
    """
    _check_kind(path, os.lstat(path))
    try:
        handle = os.open(path, flags | BESIDE | NOFOLLOW)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "it is a link (put the file itself there)", str(path)) from error
        raise
    try:
        found = os.fstat(handle)
        _check_kind(path, found)
        if found.st_size > most:
            raise OSError(errno.EINVAL, f"it is larger than {most:,} bytes, which no such file is", str(path))
        return os.fdopen(handle, "rb" if flags == os.O_RDONLY else "rb+")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: str | Path, most: int) -> bytes:
    """All that a regular file holds; see :func:`open_file`."""
    with open_file(path, most) as stream:
        # Not more than it said: some files of the system have no end.
        return stream.read(os.fstat(stream.fileno()).st_size)


def json_in(path: str | Path, most: int = LARGEST_STATE) -> Any:
    """What a file of JSON holds.

    Args:
        most: bytes that it has at most.
    Raises:
        OSError: see :func:`open_file`.
        ValueError: it is no JSON in UTF-8, holds more values than any such file, or lists lie too deep within one another.
    """
    content = read_bytes(path, most)
    parts = sum(
        content.count(mark) for mark in (b"[", b"{", b",")
    )  # a list of nothing takes two bytes, and a hundred in memory
    if parts > MOST_JSON:
        raise ValueError(f"it holds {parts:,} values, of which {MOST_JSON:,} are read")
    try:
        return json.loads(content.decode("utf-8"))
    except RecursionError:
        raise ValueError("it holds too many lists or objects within one another") from None


def refuse_links(workspace: Path) -> None:
    """Check a workspace before it is shown: Blender opens pictures by itself, and follows links. The workspace itself may be
    reached through one.

    Raises:
        ValueError: it holds a link, a pipe or a device; one line that names it.
        OSError: a folder in it cannot be read.
    """
    folders = [os.fspath(workspace)]
    while folders:
        # A run that goes on may remove a folder in this moment.
        with suppress(FileNotFoundError, NotADirectoryError), os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_symlink() or (os.name == "nt" and _is_link(entry.stat(follow_symlinks=False))):
                    raise ValueError(f"{entry.path}: is a link (put the file or folder itself there)")
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
                elif not entry.is_file(follow_symlinks=False) and os.path.lexists(entry.path):
                    raise ValueError(f"{entry.path}: Not a file but a pipe or a device (remove it)")


def _is_link(found: os.stat_result) -> bool:
    return stat.S_ISLNK(found.st_mode) or getattr(found, "st_reparse_tag", 0) == JUNCTION


def _check_kind(path: str | Path, found: os.stat_result) -> None:
    if _is_link(found):
        raise OSError(errno.ELOOP, "it is a link (put the file itself there)", str(path))
    if stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "not a file but a pipe or a device", str(path))
