# SPDX-License-Identifier: GPL-3.0-or-later
"""Which file of a picture sequence Blender shows at a frame of the timeline. No bpy here.

A movie clip names the first file of its sequence, and counts from there. An image counts by the numbers in the names.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Plates", "clip_plates", "image_plates", "number_in", "numbered_name", "numbers_like"]

LAST_NUMBER = re.compile(r"(.*?)([0-9]+)([^0-9]*)", re.DOTALL)
"""Of a file's stem: what stands before its last number, that, and what stands behind."""


def numbered_name(name: str, number: int) -> str:
    """The name of a file of a sequence, given that of another: its last number replaced, as wide as that; the name itself where it
    has no number."""
    stem, dot, suffix = name.rpartition(".")
    if not dot:
        stem, suffix = name, ""
    found = LAST_NUMBER.fullmatch(stem)
    if found is None:
        return name
    return f"{found[1]}{number:0{len(found[2])}d}{found[3]}{dot}{suffix}"


def number_in(path: Path) -> int | None:
    """The last number of a file's stem; None where it has none."""
    found = LAST_NUMBER.fullmatch(path.stem)
    return int(found[2]) if found else None


def numbers_like(path: Path) -> list[int]:
    """Numbers of the files beside one that are of its sequence, rising; its own among them where it is there.

    Raises:
        OSError: its folder cannot be listed.
    """
    found = (number_in(p) for p in path.parent.iterdir() if p.suffix == path.suffix)
    return sorted(n for n in set(found) if n is not None and path.with_name(numbered_name(path.name, n)).is_file())


@dataclass(frozen=True)
class Plates:
    """The pictures behind a camera.

    Attributes:
        first: a file of the sequence, or a still.
        shift: number of a file less the frame of the timeline that shows it.
        span: first and last frame of the timeline that show a picture of their own; None = as far as there are files.
        still: one picture stands at all frames.
    """

    first: Path
    shift: int
    span: tuple[int, int] | None = None
    still: bool = False

    def file(self, frame: int) -> Path | None:
        """The picture of a frame of the timeline, which may not be there; None outside of the sequence."""
        number = frame + self.shift
        if self.still or number < 0 or (self.span is not None and not self.span[0] <= frame <= self.span[1]):
            return None
        return self.first.with_name(numbered_name(self.first.name, number))


def clip_plates(first: Path, start: int, offset: int) -> Plates:
    """Of a movie clip.

    Args:
        first: its file; start: frame of the timeline that shows that; offset: files that are skipped.
    """
    number = number_in(first)
    return Plates(first, (number or 0) - start + offset, still=number is None)


def image_plates(first: Path, start: int, duration: int, offset: int) -> Plates:
    """Of an image: ``offset`` is what is added to the count of frames, 1 at ``start``, for the number of a file."""
    still = number_in(first) is None
    return Plates(first, 1 - start + offset, (start, start + max(duration, 1) - 1), still=still)
