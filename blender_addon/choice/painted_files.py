# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of clean frames on the disk: which of them somebody has painted, and how none is written over. No bpy here."""

from __future__ import annotations

from pathlib import Path

from ..formats.files import discard, free_name, move, write_whole
from ..formats.open_safely import LARGEST_PICTURE, read_bytes

__all__ = ["BEFORE", "begin_copy", "is_painted", "leave", "put_aside"]

BEFORE = "_before"
"""Ends the name of the copy that was painted over."""
FORGOTTEN = "_forgotten"
"""Ends the name of what somebody painted and has forgotten since; as long as nothing took its place, a mark without a suffix."""


def is_painted(folder: Path, frame: str) -> bool:
    """Whether there is a copy that somebody has painted, and did not forget: it differs from what was painted over."""
    if (folder / (frame + FORGOTTEN)).exists():
        return False
    one, before = _content(folder, frame), _content(folder, frame + BEFORE)
    return one is not None and before is not None and one != before


def leave(folder: Path, frame: str) -> None:
    """Somebody forgets what was painted: a mark allows a new copy in its place. The picture stays, for this can be undone."""
    write_whole(folder / (frame + FORGOTTEN), b"")


def begin_copy(folder: Path, frame: str, content: bytes, like: Path) -> None:
    """Make a copy to paint on, and the one that it is compared with; what may be somebody's is put aside.

    Args:
        like: the picture that it is a copy of: who may not read that may not read these either.
    Raises:
        OSError: they cannot be written.
    """
    put_aside(folder, frame)
    for name in (frame, frame + BEFORE):
        write_whole(folder / f"{name}.png", content, like=like)


def put_aside(folder: Path, frame: str) -> None:
    """Before a new copy is made: what may be somebody's keeps a name of its own, and the mark goes."""
    one = _content(folder, frame)
    if one is not None and one != _content(folder, frame + BEFORE):
        move(folder / f"{frame}.png", free_name(folder / f"{frame}.png", FORGOTTEN))
    discard(folder / (frame + FORGOTTEN))


def _content(folder: Path, name: str) -> bytes | None:
    try:
        return read_bytes(folder / f"{name}.png", LARGEST_PICTURE)
    except FileNotFoundError:
        return None
