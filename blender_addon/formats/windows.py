# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frames of a drive a preview reads: a few around each that is tried. No bpy here."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["chosen_pictures", "windows"]

REACH, STEP = 12, 2
"""Pictures before and after one that is tried, of which each second is read: what a parked car hides is seen from there."""


def chosen_pictures(now: int, count: int, named: Sequence[int] = ()) -> list[int]:
    """The pictures that are tried, rising.

    Args:
        now: number of the one that is looked at; count: of all.
        named: those that were asked for; none = the one that is looked at.
    """
    if named:
        return sorted({i for i in named if 0 <= i < count})
    return [min(max(now, 0), count - 1)]


def windows(chosen: Sequence[int], count: int, frames: str = "") -> str:
    """Ranges of frames as ``--frames`` takes them, around the pictures that are tried.

    Args:
        chosen: numbers of pictures of the imported drive, from 0; count: of all of them.
        frames: the part of the drive that was imported, as ``--frames`` took it; empty = all.
    Raises:
        ValueError: that part is not of a kind that can be counted on, in one line.
    """
    first, step = _counted(frames)
    found = []
    for i in chosen:
        low = i - STEP * min(REACH // STEP, i // STEP)
        high = min(i + REACH, count - 1)
        found.append(f"{first + step * low}:{first + step * high + 1}:{step * STEP}")
    return ",".join(found)


def _counted(frames: str) -> tuple[int, int]:
    """First frame and step of a part of a drive."""
    parts = frames.strip().split(":")
    if not frames.strip():
        return 0, 1
    if len(parts) not in (2, 3) or not all(p.strip().isdigit() or not p.strip() for p in parts):
        raise ValueError(
            f"Frames {frames!r}: a preview can count on FIRST:END:STEP from 0 alone (change it, or run everything)"
        )
    return int(parts[0] or 0), int(parts[2] or 1) if len(parts) == 3 else 1
