"""Copies of files that share no bytes with them: who paints on a copy leaves the original as it is.

Where the file system can (Btrfs, XFS, bcachefs on Linux), a copy shares its blocks until one of the two is written, and takes
neither time nor room. Hard links, by which a file is its original, are made only where they are asked for, see
:data:`LINK_VARIABLE`.
"""

from __future__ import annotations

import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from unveil_core.base.disk.open_safely import open_file, read_bytes
from unveil_core.base.files import write_atomic, write_bytes_atomic
from unveil_core.base.pictures.metadata import Metadata

__all__ = ["LINK_VARIABLE", "copied", "copied_or_linked", "copied_png", "linked"]

LINK_VARIABLE = "UNVEIL_LINK"
"""Of the environment; set to 1, imported photographs are hard links to the originals: no room is taken, and whoever writes in the
workspace's picture writes in the original."""
FICLONE = 0x40049409
"""Linux' request to share a file's blocks with another one."""


def copied(source: Path, destination: Path) -> None:
    """Make ``destination`` a copy of a file, or of what a link leads to: whole or not at all.

    Raises:
        OSError: one cannot be read or is no regular file, or the other cannot be written.
    """
    with open_file(source) as content:

        def put(stream: BinaryIO) -> None:
            if not _cloned(content, stream):
                shutil.copyfileobj(content, stream, 1 << 20)

        write_atomic(destination, put, like=source)


def copied_png(source: Path, destination: Path, metadata: Metadata) -> None:
    """The same of a PNG, with what another picture has beside its pixels in it.

    Raises:
        OSError: see :func:`copied`.
    """
    if metadata:
        write_bytes_atomic(destination, metadata.in_png(read_bytes(source)), like=source)
    else:
        copied(source, destination)


def copied_or_linked(source: Path, destination: Path) -> None:
    """The same; a hard link where the user chose these and the file system has them."""
    (linked if os.environ.get(LINK_VARIABLE) == "1" else copied)(source, destination)


def linked(source: Path, destination: Path) -> None:
    """Make ``destination`` a hard link to a file, which is not written through it; a copy where the file system has none."""
    destination.parent.mkdir(parents=True, exist_ok=True)
    with suppress(OSError):
        os.link(Path(source).resolve(), destination)
        return
    copied(source, destination)


def _cloned(source: BinaryIO, target: BinaryIO) -> bool:
    """Share the blocks of an open file with an empty one, where system and file system can: Linux has a call for open files."""
    if sys.platform != "linux":
        return False
    import fcntl

    with suppress(OSError):
        fcntl.ioctl(target.fileno(), FICLONE, source.fileno())
        return True
    return False
