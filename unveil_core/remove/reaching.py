"""Surfels that reach behind removed objects, or out of all pictures: what nobody saw of them goes.

A surfel at the border of what a removed object hides is held by what the frames show of it; its other end lies behind the object,
where nothing holds it, and is often long and wrong: a streak down the wall when the object has gone, or a piece of the sky,
hundreds of metres wide, that cuts through the street. Such a surfel is shortened to the part that some frame shows.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.geometry.grid import PointGrid
from unveil_core.remove.observed import CELL_M, SeenViews, seen_by_some
from unveil_core.surfels.scene_edit import NOT_SHORTENED, Shortened
from unveil_core.surfels.surfels import Surfels, rotations

__all__ = ["shortened"]

REACH = 2.5
"""Standard deviations to which a surfel is looked at: beyond, it covers less than a twentieth of what lies behind it."""
STEPS, PASSES = 5, 4
"""Places on each of a surfel's four arms that are looked for in the frames; and how often, a tenth being left of a surfel of
hundreds of metres each time."""
LEAST_M = 1.0
"""Length of an arm below which it is let be, metres. Of two streets by seed one lost its streaks (+0.3 dB) and the other did not
change; shortened from 0.1 m on, walls and hedges lost what carried on behind objects rightly (-0.3 dB on three)."""
SHORTEST = 0.1
"""Least share of an axis that is left."""
AT_ONCE = 50_000
"""Surfels that are looked at together: with all their places some tens of megabytes."""


def shortened(surfels: Surfels, stays: Mask, views: SeenViews) -> Shortened:
    """The surfels that reach to where no frame looks.

    Args:
        surfels: of the full scene, N of them; stays: (N,) those that are not removed.
        views: what the frames show.
    """
    long = np.flatnonzero(stays & (REACH * np.exp(surfels.log_scales.numpy()[:, :2].max(axis=1)) > LEAST_M))
    # Those of one place together: they ask the same frames.
    order = long[PointGrid(surfels.means[torch.from_numpy(long)].double().numpy(), CELL_M).order]
    parts = [_of_some(surfels, order[k : k + AT_ONCE], views) for k in range(0, len(order), AT_ONCE)]
    return Shortened.from_table(np.concatenate([NOT_SHORTENED.table(), *(part.table() for part in parts)]))


def _of_some(surfels: Surfels, index: NDArray[np.int64], views: SeenViews) -> Shortened:
    """The same of the surfels ``index`` (K,)."""
    some = torch.from_numpy(index)
    scale = np.exp(surfels.log_scales[some].double().numpy()[:, :2])
    axes = rotations(surfels.quats[some]).double().numpy()[:, :, :2].transpose(0, 2, 1)
    centre = surfels.means[some].double().numpy()
    share, moved = np.ones_like(scale), np.zeros_like(centre)
    asked = np.arange(len(index))
    for _ in range(PASSES):
        if not len(asked):
            break
        now = share[asked] * scale[asked]
        left, middle = _what_is_left(centre[asked] + moved[asked], axes[asked], now, views)
        share[asked] *= left
        moved[asked] += ((middle * now)[:, :, None] * axes[asked]).sum(axis=1)
        # Where the places on an arm lie metres apart, they are looked for again, closer to each other.
        apart = REACH * share[asked] * scale[asked] / STEPS
        asked = asked[(left < 1).any(axis=1) & (apart > LEAST_M).any(axis=1)]
    less = (share < 1).any(axis=1)
    means = (centre + moved).astype(np.float32)
    scales = surfels.log_scales[some].numpy().copy()
    scales[:, :2] += np.log(share).astype(np.float32)
    return Shortened(index[less], means[less], scales[less])


def _what_is_left(centre: Float64, axes: Float64, scale: Float64, views: SeenViews) -> tuple[Float64, Float64]:
    """(K, 2) share of each axis that is left, and where its middle lies, in standard deviations.

    Args:
        centre: (K, 3) world; axes: (K, 2, 3) unit vectors; scale: (K, 2) their standard deviations.
    """
    along = np.linspace(-REACH, REACH, 2 * STEPS + 1)
    places = (centre[:, None, None] + along[:, None] * (axes * scale[:, :, None])[:, :, None]).reshape(-1, 3)
    seen = seen_by_some(places, np.zeros((0, 3)), views, places[0])[0]
    lost = np.zeros(len(places), dtype=bool)
    lost[~seen] = _without_evidence(places[~seen], views)
    first, last, found = _part(*(m.reshape(len(centre), 2, len(along)) for m in (seen, ~lost)))
    low, high = along[first], along[last]
    whole = ~found | (REACH * scale <= LEAST_M)
    share = np.where(whole, 1.0, np.maximum((high - low) / (2 * REACH), SHORTEST))
    most = REACH * (1 - share)
    return share, np.where(share < 1, np.clip((low + high) / 2, -most, most), 0.0)


def _part(seen: Mask, kept: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64], Mask]:
    """First and last step (K, 2) of each axis' part that stays, and whether anything of it is seen.

    Args:
        seen, kept: (K, 2, T) places on the axes that some frame shows, and those that are not lost.
    """
    steps = seen.shape[2]
    length, count = np.zeros(seen.shape, dtype=np.int64), np.zeros(seen.shape, dtype=np.int64)
    for k in range(steps):
        before = (length[..., k - 1], count[..., k - 1]) if k else (0, 0)
        length[..., k] = (before[0] + 1) * kept[..., k]
        count[..., k] = (before[1] + seen[..., k]) * kept[..., k]
    end = np.zeros(seen.shape, dtype=np.int64)
    for k in range(steps - 1, -1, -1):
        end[..., k] = k if k == steps - 1 else np.where(kept[..., k + 1], end[..., k + 1], k)
    # Of several parts the one of which most is seen: the middle may lie where nobody looked.
    best = count.argmax(axis=2)[..., None]
    last = np.take_along_axis(end, best, axis=2)
    first = last - np.take_along_axis(length, last, axis=2) + 1
    return first[..., 0], last[..., 0], count.max(axis=2) > 0


def _without_evidence(places: Float64, views: SeenViews) -> Mask:
    """(P,) whether a removed object hides the place in some frame, or no picture holds it."""
    hidden, pictured = np.zeros((2, len(places)), dtype=bool)
    if not len(places):
        return hidden
    grid = PointGrid(places, CELL_M)
    ordered = places[grid.order]
    low, high = (extreme.reduceat(ordered, grid.first) for extreme in (np.minimum, np.maximum))
    asked = views.near(places, ASKED_M)
    may_show = views.may_show(asked, low, high, ASKED_M)
    for k, v in enumerate(asked):
        index = grid.of_cells(may_show[k])
        index = index[~hidden[index]]
        pixel, depth = views.cameras[v].project(places[index])
        inside = views.cameras[v].in_picture(pixel, depth)
        x, y = pixel[inside].astype(np.int64).T
        hidden[index[inside]] = views.frames[v].hidden[y, x]
        pictured[index[inside]] = True
    return hidden | ~pictured
