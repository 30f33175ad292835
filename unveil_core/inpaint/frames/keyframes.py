"""Keyframes: the few frames that invent what nobody saw, for themselves and for all others.

*3D StreetUnveiler*, section 3.3, inpaints keyframes from the last to the first and carries their content along. Here they
are chosen greedily, by how much unobserved surface each newly shows: what a chosen frame carries to the others, as surfels on its
completed depth, no longer counts there. A place counts for a frame only if no other sees it much sharper. Frames that would newly
show too little are no keyframes. All cameras of a rig are planned together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.resume.checkpoint import Checkpoint, Kept
from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.geometry.images import area_px
from unveil_core.geometry.reach import cameras_near, centres_of
from unveil_core.inpaint.frames.holes import Hole

__all__ = ["Keyframe", "Plan", "carried", "plan_keyframes", "sharper_elsewhere"]

MUCH_SHARPER = 1.25
"""Ratio of resolutions from which on a place is left to the sharper view, even if that comes later in the order. Chosen on the two
sample streets."""
AS_MUCH = 0.8
"""Share of what the best frame newly shows from which on a frame that comes earlier in the order is chosen in its place. Chosen on
the two sample streets."""
LEAST_SHARE = 0.01
"""Share of the area that all keyframes invent below which a frame is no keyframe."""
LEAST_PX = 40
"""Pixels at 384x256, in proportion in larger images, below which what a frame newly shows makes it no keyframe. Chosen on the two
sample streets."""
LARGEST_SEED_PX = 12
"""Radius at which a carried surfel is drawn at most, pixels: it bounds the time, and what is so close hides a frame anyway."""
ASKED_PX = 3000
"""Pixels of a hole for which every other frame is asked whether it sees them sharper; larger holes are thinned."""


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A frame that invents for all others.

    Attributes:
        frame: its index.
        area: of the surface that it newly shows at its turn, as it faces the camera, square metres; pixels: their number.
        deferred: (H, W) bool, pixels that are left to a later keyframe, which sees the place much sharper.
    """

    frame: int
    area: float
    pixels: int
    deferred: Mask


@dataclass(frozen=True, eq=False)
class Plan:
    """Which frames invent, in the order in which they do.

    Attributes:
        keyframes: in that order.
        visit_order: indices of all frames, by time in the plan's direction.
        remaining: (N,) int, pixels of each frame's hole that no keyframe is expected to fill.
    """

    keyframes: tuple[Keyframe, ...]
    visit_order: tuple[int, ...]
    remaining: NDArray[np.int64]


def plan_keyframes(
    holes: Sequence[Hole],
    times: Sequence[float] | NDArray[np.float64],
    *,
    order: str = "reverse",
    given: Sequence[int] | None = None,
    kept: Kept | None = None,
) -> Plan:
    """Choose the frames that invent, and their order.

    Args:
        holes: of all frames, one per frame, empty masks included; times: (N,) when they were taken.
        order: "reverse", last to first, a place deferred to the view that sees it much sharper; "forward", first to last, each
            place invented in the first frame that shows it, for comparison.
        given: indices that are keyframes, and no others.
        kept: from which an interrupted call goes on.
    """
    late = np.asarray(times, dtype=np.float64) * (1.0 if order == "reverse" else -1.0)
    every, kept = _Holes(holes), Kept() if kept is None else kept
    counts = [np.ones(size, dtype=bool) for size in every.sizes]
    least = np.array([area_px((c.height, c.width), LEAST_PX) for c in every.cameras])
    if given is None:
        if order == "reverse" and on("deferred_places"):
            counts = [_sharpest_here(every, i, kept) for i in range(len(holes))]
        chosen = _greedy(every, counts, late, least, kept.checkpoint("chosen"))
    else:
        chosen = list(given)
    visit_order = sorted(range(len(holes)), key=lambda i: (-late[i], i))
    wanted = set(chosen)
    chosen = [i for i in visit_order if i in wanted]
    free = [np.ones(size, dtype=bool) for size in every.sizes]
    keyframes: list[Keyframe] = []
    begun, checkpoint = 0, kept.checkpoint("keyframes")
    if (saved := checkpoint.load()) is not None:
        begun, told = saved[1]["turn"], saved[1]["told"]
        free = _masks(saved[0]["free"], every.sizes)
        deferred = _masks(saved[0]["deferred"], [holes[i].mask.size for i, _, _ in told])
        keyframes = [
            Keyframe(i, area, pixels, left.reshape(holes[i].mask.shape))
            for (i, area, pixels), left in zip(told, deferred, strict=True)
        ]
    for turn, i in enumerate(chosen):
        if turn < begun:
            continue
        if checkpoint.due():
            told = [(k.frame, k.area, k.pixels) for k in keyframes]
            masks = {"free": _bits(free), "deferred": _bits([k.deferred.ravel() for k in keyframes])}
            checkpoint.save(masks, {"turn": turn, "told": told})
        hole, invents = holes[i], free[i]
        if order == "reverse" and on("deferred_places"):
            invents = invents & ~sharper_elsewhere(hole, every.near(hole, chosen[turn + 1 :], i))
        if given is None and invents.sum() < least[i]:
            continue  # frames that were chosen later and come earlier show together what it was chosen for
        deferred_here = np.zeros_like(hole.mask)
        deferred_here[hole.mask] = free[i] & ~invents
        keyframes.append(Keyframe(i, float(hole.area()[invents].sum()), int(invents.sum()), deferred_here))
        _take(every, i, invents, free)
    return Plan(tuple(keyframes), tuple(visit_order), np.array([int(f.sum()) for f in free], dtype=np.int64))


def _bits(masks: Sequence[Mask]) -> NDArray[np.uint8]:
    """Masks (P,) as bits, one after the other."""
    return np.packbits(np.concatenate([np.zeros(0, dtype=bool), *masks]))


def _masks(bits: NDArray[np.uint8], sizes: Sequence[int]) -> list[Mask]:
    """Inverse of :func:`_bits`."""
    every = np.unpackbits(bits, count=sum(sizes)).astype(bool)
    return np.split(every, np.cumsum(sizes)[:-1]) if sizes else []


class _Holes:
    """The holes of all frames, of which each is asked for only where another may show the same place."""

    def __init__(self, holes: Sequence[Hole]) -> None:
        self.holes = holes
        first = [(hole.camera, len(hole.depth)) for hole in holes]
        self.cameras, self.sizes = [camera for camera, _ in first], [size for _, size in first]
        self.centres = centres_of(self.cameras)

    def near(self, hole: Hole, candidates: Iterable[int], own: int) -> Iterator[Hole]:
        """Those of the candidates, but for ``own``, whose cameras come near what a hole shows."""
        close = set(cameras_near(self.centres, hole.points(), ASKED_M).tolist())
        return (self.holes[j] for j in candidates if j in close and j != own and self.sizes[j])


def _sharpest_here(every: _Holes, i: int, kept: Kept) -> Mask:
    """(P,) which pixels of a hole no other frame sees much sharper."""
    size = every.sizes[i]
    if not size:
        return np.zeros(0, dtype=bool)

    def look() -> dict[str, NDArray[np.uint8]]:
        hole = every.holes[i]
        return {"pixels": _bits([~sharper_elsewhere(hole, every.near(hole, range(len(every.sizes)), i))])}

    return _masks(kept.within("sharpest").once(str(i), look)["pixels"], [size])[0]


def _greedy(
    every: _Holes,
    counts: Sequence[Mask],
    late: NDArray[np.float64],
    least: NDArray[np.int64],
    checkpoint: Checkpoint,
) -> list[int]:
    """Frames that each newly show most of what counts for them (``counts``, (P,) per hole), until none shows enough."""
    free = [np.ones(size, dtype=bool) for size in every.sizes]
    newly = np.array([float(hole.area()[c].sum()) for hole, c in zip(every.holes, counts, strict=True)])
    pixels = np.array([int(c.sum()) for c in counts])
    chosen: list[int] = []
    taken = 0.0
    if (saved := checkpoint.load()) is not None:
        free = _masks(saved[0]["free"], every.sizes)
        newly, pixels = saved[0]["newly"], saved[0]["pixels"]
        chosen, taken = saved[1]["chosen"], saved[1]["taken"]
    while True:
        if checkpoint.due():
            state = {"free": _bits(free), "newly": newly, "pixels": pixels}
            checkpoint.save(state, {"chosen": chosen, "taken": taken})
        able = np.flatnonzero((pixels >= least) & (newly > LEAST_SHARE * taken))
        able = able[~np.isin(able, chosen)]
        if not len(able):
            return chosen
        best = able[newly[able] >= AS_MUCH * newly[able].max()]
        i = int(best[np.lexsort((best, -newly[best], -late[best]))[0]])
        chosen.append(i)
        taken += newly[i]
        for j in _take(every, i, free[i] & counts[i], free):
            new = free[j] & counts[j]
            newly[j], pixels[j] = float(every.holes[j].area()[new].sum()), int(new.sum())


def _take(every: _Holes, i: int, invents: Mask, free: list[Mask]) -> list[int]:
    """Mark in ``free`` what frame ``i`` carries to each frame when it invents these of its pixels; returns the frames changed."""
    changed = [i]
    free[i] = free[i] & ~invents
    hole = every.holes[i]
    points, size = hole.points()[invents], hole.depth[invents] / hole.camera.fx
    for j in cameras_near(every.centres, points, ASKED_M).tolist():
        if j != i and free[j].any():
            shown = carried(points, size, every.holes[j])
            if (shown & free[j]).any():
                free[j] = free[j] & ~shown
                changed.append(j)
    return changed


def _in_view(
    hole: Hole, points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Mask, NDArray[np.float64]]:
    """Rows and columns of points (P, 3), 0 outside the view, whether they lie in the view, and their depth."""
    pixel, depth = hole.camera.project(points)
    inside = hole.camera.in_picture(pixel, depth)
    safe = np.where(inside[:, None], pixel, 0).astype(np.int64)
    return safe[:, 1], safe[:, 0], inside, depth


def carried(points: NDArray[np.float64], size: NDArray[np.float64], other: Hole) -> Mask:
    """(P',) which pixels of another frame's hole show discs carried there, at ``points`` (P, 3) and as wide as ``size`` (P,)."""
    row, column, inside, depth = _in_view(other, points)
    row, column = row[inside], column[inside]
    radius = np.round(0.5 * size[inside] * other.camera.fx / depth[inside]).astype(np.int64).clip(0, LARGEST_SEED_PX)
    shown = np.zeros(other.mask.shape, dtype=np.uint8)
    for r in np.unique(radius):
        some = radius == r
        spot = np.zeros_like(shown)
        spot[row[some], column[some]] = 1
        side = 2 * int(r) + 1
        # A disc's neighbours may lie a pixel apart without a gap between them.
        spot = cv2.morphologyEx(spot, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        shown |= cv2.dilate(spot, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))) if r else spot
    return shown[other.mask].astype(bool)


def sharper_elsewhere(hole: Hole, others: Iterable[Hole]) -> Mask:
    """(P,) which of a hole's pixels show a place that lies in another frame's hole, too, and is much finer there."""
    step = max(1, math.ceil(math.sqrt(len(hole.depth) / ASKED_PX)))
    row, column = np.nonzero(hole.mask)
    # One pixel of each block is asked for, and answers for the block.
    _, asked, block = np.unique(
        (row // step) * hole.mask.shape[1] + column // step, return_index=True, return_inverse=True
    )
    points = hole.points()[asked]
    size = hole.depth[asked] / hole.camera.fx
    found = np.zeros(len(size), dtype=bool)
    for other in others:
        open_ = np.flatnonzero(~found)
        if not len(open_):
            break
        row, column, inside, depth = _in_view(other, points[open_])
        finer = inside & other.mask[row, column] & (depth / other.camera.fx * MUCH_SHARPER < size[open_])
        found[open_[finer]] = True
    answer: Mask = found[block.ravel()]
    return answer
