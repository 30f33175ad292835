"""What other frames show of the places behind a frame's removed objects: how many show them, and which colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.delivery.views import EmptyView, EmptyViews, others_near, sees
from unveil_core.geometry.images import sample_at

__all__ = ["Seen", "Witnesses", "seen_by"]

MOST_WITNESSES, MOST_NEAR = 24, 96
"""Frames that are asked, evenly chosen of the so many nearest: more show nothing else, and would take time."""
SKY_M = 1e5
"""Distance at which the sky is looked up, metres: the cameras of a drive lie in one point there."""


@dataclass(frozen=True, eq=False)
class Witnesses:
    """The frames that can be asked.

    Attributes:
        views: what they show.
        pictures: (H, W, 3) levels of 255, their photographs, smoothed, in canonical colours.
    """

    views: EmptyViews
    pictures: Sequence[Levels]


@dataclass(frozen=True, eq=False)
class Seen:
    """What other frames show of P pixels.

    Attributes:
        count: (P,) frames that show the place.
        color: (P, 3) their mean, levels of 255, nearer ones weigh more; spread: (P,) root mean square distance from it, levels.
            Both 0 where no frame shows it.
    """

    count: Float32
    color: Float32
    spread: Float32


def seen_by(witnesses: Witnesses, own: int, pixels: Mask) -> Seen:
    """What the other frames show of pixels (H, W) of frame ``own``."""
    here = witnesses.views.frames[own]
    depth, rays = here.depth[pixels].astype(np.float64), here.camera.rays()[pixels]
    sky = depth == 0
    points: Float64 = here.camera.centre + np.where(sky, SKY_M, depth)[:, None] * rays
    count, total = np.zeros(len(points)), np.zeros(len(points))
    color, square = np.zeros((len(points), 3)), np.zeros(len(points))
    for j in _asked(witnesses, own):
        other = witnesses.views.frames[j]
        index, at, far = sees(other, points)
        if sky.any():
            ground = ~sky[index]
            there, place, away = _shows_sky(other, points[sky])
            index = np.concatenate([index[ground], np.flatnonzero(sky)[there]])
            at, far = np.concatenate([at[ground], place]), np.concatenate([far[ground], away])
        if not len(index):
            continue
        found = sample_at(witnesses.pictures[j], at).astype(np.float64)
        weight = 1.0 / far
        count[index] += 1
        total[index] += weight
        color[index] += weight[:, None] * found
        square[index] += weight * np.square(found).mean(axis=1)
    total = np.maximum(total, 1e-12)
    color /= total[:, None]
    spread = np.sqrt(np.maximum(square / total - np.square(color).mean(axis=1), 0))
    return Seen(count.astype(np.float32), color.astype(np.float32), spread.astype(np.float32))


def _asked(witnesses: Witnesses, own: int) -> list[int]:
    """The frames that are asked about frame ``own``."""
    near = others_near(witnesses.views, own)[:MOST_NEAR]
    return near[:: max(1, -(-len(near) // MOST_WITNESSES))]


def _shows_sky(view: EmptyView, points: Float64) -> tuple[NDArray[np.int64], Float64, Float64]:
    """Which far points (P, 3) a view shows as sky, as :func:`delivery.views.sees` gives them."""
    index, pixels, depth = view.camera.shown(points)
    row, column = view.at(pixels)
    sky = (view.depth[row, column] == 0) & ~view.barred[row, column]
    return index[sky], pixels[sky], depth[sky]
