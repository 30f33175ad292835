"""What tells of a file whether it is as it was written: its size, its time, and a digest of its content."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from stat import S_ISREG

from unveil_core.base.disk.open_safely import open_file

__all__ = ["Stamp", "digest_of", "is_as_it_was", "is_unchanged", "mark_of", "stamp_of"]

Stamp = list[int | str]
"""Bytes, nanoseconds of the last change, digest in hexadecimal; as JSON has it. The digest is "" where the content was not read: of
a file with more than one name, which is a link to somebody's, and where size and time have to do."""


def stamp_of(file: Path, *, content: bool = True) -> Stamp:
    """The stamp of a file, or of a link itself.

    Args:
        content: whether it is read for its digest.
    Raises:
        OSError: it cannot be read.
    """
    found = file.stat(follow_symlinks=False)
    alone = S_ISREG(found.st_mode) and found.st_nlink == 1
    return [found.st_size, found.st_mtime_ns, digest_of(file) if alone and content else ""]


def is_unchanged(file: Path, held: object) -> bool:
    """Whether a file is as its stamp says: of the same size and time, or, as after it was copied, of the same content."""
    if not isinstance(held, list) or len(held) != 3:
        return False
    try:
        found = file.stat(follow_symlinks=False)
        if found.st_size != held[0]:
            return False
        return found.st_mtime_ns == held[1] or (bool(held[2]) and digest_of(file) == held[2])
    except OSError:
        return False


def is_as_it_was(file: Path, held: object) -> bool:
    """The same, where a file that is gone, or that has no stamp, counts as it was."""
    return held is None or not os.path.lexists(file) or is_unchanged(file, held)


def mark_of(file: Path, name: str) -> str:
    """A mark of a file by its name and size, wherever it lies: sets of footage that share none are different footage.

    Args:
        name: that stands for the file's own, as that of a frame.
    Raises:
        OSError: it is not there.
    """
    told = f"{file.stat().st_size} {name}".encode(errors="surrogateescape")
    return hashlib.blake2b(told, digest_size=8).hexdigest()


def digest_of(file: Path, *, links: bool = False) -> str:
    """The digest of a file's content, as stamps have it.

    Args:
        links: whether a symbolic link is followed.
    Raises:
        OSError: it cannot be read.
    """
    with open_file(file, links=links) as stream:
        return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()  # type: ignore[arg-type]
