# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frame of the timeline shows which picture of a drive. No bpy here.

By the time stamps, where the drive has them: a camera that lost a picture stays in step with the others of its rig. The picture
before a gap stays until the next one. Without time stamps picture n of each camera is frame n.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from .drive_files import DriveFrame, ImportedDrive

__all__ = ["Timeline", "timeline_of"]

MOST_HELD = 10
"""Frames of the timeline for each picture, at most: a drive with longer pauses goes picture by picture."""
T = TypeVar("T")


@dataclass(frozen=True)
class Timeline:
    """Attributes:
    start: the first frame.
    frames: by track, the frame of each of its pictures, rising.
    rate: frames a second; None where the drive does not tell.
    """

    start: int
    frames: dict[str, tuple[int, ...]]
    rate: float | None

    @property
    def end(self) -> int:
        """The last frame."""
        return max(frames[-1] for frames in self.frames.values())

    def first(self, track: str) -> int:
        """The frame of a track's first picture."""
        return self.frames[track][0]

    def at(self, track: str, frame: int) -> int:
        """Number, from 0, of the picture that a track shows at a frame; before its first the first, after its last the last."""
        return max(bisect_right(self.frames[track], frame) - 1, 0)

    def held(self, track: str, things: Sequence[T]) -> list[T]:
        """One thing for each frame from a track's first picture to its last, given one for each picture."""
        frames = self.frames[track]
        ends = (*frames[1:], frames[-1] + 1)
        return [thing for thing, frame, end in zip(things, frames, ends, strict=True) for _ in range(end - frame)]


def timeline_of(drive: ImportedDrive, start: int) -> Timeline:
    """The timeline of a drive.

    Args:
        start: frame of its first picture.
    """
    counted = {track: tuple(range(start, start + len(frames))) for track, frames in drive.tracks.items()}
    try:
        timed = _timed(drive.tracks, drive.frame_rate, start)
    except (OverflowError, ValueError):  # no numbers of a clock
        timed = None
    return Timeline(start, timed or counted, drive.frame_rate)


def _timed(
    tracks: dict[str, tuple[DriveFrame, ...]], rate: float | None, start: int
) -> dict[str, tuple[int, ...]] | None:
    """Frames by time stamps; None where these do not tell."""
    if not rate or any(f.timestamp is None for frames in tracks.values() for f in frames):
        return None
    begins = {track: float(frames[0].timestamp or 0) for track, frames in tracks.items()}
    earliest = min(begins.values())
    found = {}
    for track, frames in tracks.items():
        # Each camera by its own first picture: those of a rig are not exposed at the same instant.
        first = start + round((begins[track] - earliest) * rate)
        own = tuple(first + round((float(f.timestamp or 0) - begins[track]) * rate) for f in frames)
        rising = all(b > a for a, b in zip(own, own[1:], strict=False))
        if not rising or own[-1] - start >= MOST_HELD * len(frames):
            return None
        found[track] = own
    return found
