"""What makes a solve fail, told before it begins: each in one line with what helps."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float32
from unveil_core.solve.looks.choice import Choice
from unveil_core.solve.looks.motion import Motion, followed, moved
from unveil_core.solve.looks.shutter import told_of_shutter
from unveil_core.solve.looks.thumbs import Thumbs

__all__ = ["DARK", "FEWEST_FRAMES", "check_can_work", "too_dark"]

FEWEST_FRAMES = 6
"""With fewer, one wrong match decides."""
STOOD_PX = 1.5
"""Largest median motion between any two frames of a camera that stands, pixels of a small picture."""
FEWEST_CORNERS = 40
"""Corners that are followed between two frames that are solved, at the median; with fewer the solve breaks. Photographs taken on
foot that keep 54 are solved to 0.3 % of their way."""
HELD_PX = 0.5
"""Distance from the line on which the camera's motion allows a corner."""
DARK, DIM = 20.0, 45.0
"""Mean grey of a night without light, and of one that lamps light."""
FLAT_SHARE, FLAT_PX = 0.9, 1.0
"""One plane, or a camera that only turns: so large a share of the corners moves as a homography says, to so many pixels of 640."""
PAIRS = 8
"""Pairs of frames that are looked at."""
PAIR_PX = 12.0
"""Motion between the two frames of a pair at least, pixels of a small picture: with less, a plane explains everything."""


def check_can_work(
    source: Path | str, thumbs: Thumbs, motion: Motion, choice: Choice, mask: NDArray[np.bool_] | None = None
) -> list[str]:
    """Check the frames of one camera for what cannot be solved; returns what a user should know all the same.

    Args:
        source: for messages; mask: (h, w) of a small picture, where it shows what stays.
    Raises:
        DriveError: too few frames, a cut, a standing or only turning camera, nothing to follow.
    """
    count = len(thumbs.frames)
    if count < FEWEST_FRAMES:
        raise DriveError(
            f"Too few frames: {count}, and a solve needs {FEWEST_FRAMES}",
            path=source,
            mend="give a longer part of the clip, or a smaller --every",
        )
    dim = float(np.median(thumbs.brightness))
    corners = [followed(thumbs.pictures[a], thumbs.pictures[b], _sized(mask, thumbs)) for a, b in _steps(choice)]
    held = float(np.median([_held(a, b) for a, b in corners])) if corners else 0.0
    if dim < DARK and (held < FEWEST_CORNERS or len(motion.cuts) > 1):  # noise looks like cuts
        raise too_dark(source, dim)
    if motion.cuts:
        raise DriveError(_cut_told(motion.cuts, thumbs), path=source, mend=_longest_part(motion.cuts, thumbs))
    if _stood(thumbs, motion):
        raise DriveError(
            "The camera stands still, so no distance can be found",
            path=source,
            mend="film while driving or walking, or give the part that moves: --frames A:B",
        )
    if held < FEWEST_CORNERS:
        raise DriveError(
            f"Too little can be tracked: {held:.0f} corners from frame to frame, and {FEWEST_CORNERS} are needed",
            path=source,
            mend="use sharper footage, more frames a second (a smaller --every), or a part with more texture: --frames A:B",
        )
    pairs = _pairs(thumbs, motion)
    flat = [f for a, b in pairs if (f := _flatness(*_wide(thumbs, a, b, mask))) is not None]
    if len(flat) >= 3 and float(np.median(flat)) > FLAT_SHARE:
        raise DriveError(
            "Everything moves as one plane: the camera only turns, or films a single wall or the bare ground",
            path=source,
            mend="move the camera along the street, with houses, trees or cars at several distances in view",
        )
    told = []
    if dim < DIM:
        told.append(f"the footage is dark (mean {dim:.0f} of 255): expect fewer points; a brighter exposure helps")
    bent = told_of_shutter(thumbs, motion)
    return told if bent is None else [*told, bent]


def too_dark(source: Path | str, grey: float) -> DriveError:
    """What is said of a night without light; ``grey``: mean of its frames."""
    return DriveError(
        f"The footage is too dark (mean grey {grey:.0f} of 255): its noise hides the street",
        path=source,
        mend="film by day, or with a longer exposure on a slower drive",
    )


def _cut_told(cuts: tuple[int, ...], thumbs: Thumbs) -> str:
    first = thumbs.frames[cuts[0]]
    more = f", and {len(cuts) - 1} more" if len(cuts) > 1 else ""
    return f"A cut before frame {first.number}{more}: the frames do not show one place"


def _longest_part(cuts: tuple[int, ...], thumbs: Thumbs) -> str:
    ends = [0, *cuts, len(thumbs.frames)]
    a, b = max(zip(ends, ends[1:], strict=False), key=lambda p: p[1] - p[0])
    first, last = thumbs.frames[a].number, thumbs.frames[b - 1].number
    return f"give one shot: --frames {first}:{last + 1} is the longest"


def _stood(thumbs: Thumbs, motion: Motion) -> bool:
    """Whether the picture hardly moves between any frames that lie apart, also slowly."""
    if float(np.median(motion.step)) > STOOD_PX or float(motion.step.max(initial=0)) > 3 * STOOD_PX:
        return False
    count = len(thumbs.frames)
    spread = [round(k * (count - 1) / 4) for k in range(5)]
    sizes = [
        float(np.median(np.linalg.norm(moved(thumbs.small(a), thumbs.small(b)), axis=2)))
        for i, a in enumerate(spread)
        for b in spread[i + 1 :]
    ]
    return max(sizes) < STOOD_PX or float(np.mean(~motion.stands)) < 0.02


def _pairs(thumbs: Thumbs, motion: Motion) -> list[tuple[int, int]]:
    """Pairs of frames, spread over the clip, each so far apart that motion tells planes from streets."""
    gone = np.concatenate([[0.0], np.cumsum(motion.step)])
    starts = np.unique(np.linspace(0, len(thumbs.frames) - 2, PAIRS).astype(int))
    found = []
    for a in starts:
        beyond = np.flatnonzero(gone > gone[a] + PAIR_PX)
        if len(beyond):
            found.append((int(a), int(beyond[0])))
    return found


def _steps(choice: Choice) -> list[tuple[int, int]]:
    steps = list(zip(choice.frames, choice.frames[1:], strict=False))
    return steps[:: max(1, len(steps) // PAIRS)]


def _sized(mask: NDArray[np.bool_] | None, thumbs: Thumbs) -> NDArray[np.bool_] | None:
    if mask is None:
        return None
    height, width = thumbs.pictures[0].shape
    return np.asarray(cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)) > 0


def _wide(thumbs: Thumbs, a: int, b: int, mask: NDArray[np.bool_] | None) -> tuple[Float32, Float32]:
    """Corners followed from one frame to another far one, through those between."""
    start, _ = followed(thumbs.pictures[a], thumbs.pictures[a], _sized(mask, thumbs))
    at, alive = start.copy(), np.ones(len(start), bool)
    for k in range(a, b):
        if not len(at):
            break
        there, found, _ = cv2.calcOpticalFlowPyrLK(
            thumbs.pictures[k], thumbs.pictures[k + 1], at[:, None], None, winSize=(15, 15), maxLevel=4
        )
        alive &= found[:, 0] > 0
        at = there[:, 0]
    return start[alive], at[alive]


def _held(first: Float32, second: Float32) -> int:
    """Corners that one motion of a camera explains: noise has corners, too."""
    if len(first) < 8:
        return 0
    _, inside = cv2.findFundamentalMat(first, second, cv2.FM_RANSAC, HELD_PX, 0.99)
    return 0 if inside is None else int(inside.sum())


def _flatness(first: Float32, second: Float32) -> float | None:
    """Share of the corners that one homography explains, among those that one motion of a camera does; None of too few."""
    if len(first) < 40:
        return None
    _, rigid = cv2.findFundamentalMat(first, second, cv2.FM_RANSAC, FLAT_PX, 0.999)
    _, plane = cv2.findHomography(first, second, cv2.RANSAC, FLAT_PX)
    if rigid is None or plane is None:
        return None
    either = rigid[:, 0].astype(bool) | plane[:, 0].astype(bool)
    return float(plane.sum() / max(1, either.sum()))
