"""Which of the places behind what is removed some other frame saw.

*3D StreetUnveiler*, section 3.2, takes the fall of alpha for what nobody saw. That calls sky behind a car unseen, and a wall
seen that shows far off through a gap. Here the place that must be there is asked for: the surface that is left, the ground, or
the sky, and whether a frame shows it that no removed object hides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera

__all__ = ["SeenView", "never_seen", "places_seen", "seen_view", "sky_seen"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
AGREEMENT = 0.15
"""Share of its depth by which what a frame shows may be nearer than a place and still not be called in front of it: the surface
behind what is removed is known so well."""
SKY_ALPHA, SURFACE = 0.3, 0.5
"""A pixel of the full scene with less alpha shows sky, one of the empty scene with more shows a surface."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """What a frame shows.

    Attributes:
        camera: of the frame.
        depth: (H, W) float32 of the full scene, along the optical axis, inf where it shows sky.
        hidden: (H, W) bool, pixels that show a removed object.
    """

    camera: Camera
    depth: NDArray[np.float32]
    hidden: Mask


def seen_view(camera: Camera, depth: NDArray[np.float32], alpha: NDArray[np.float32], hidden: Mask) -> SeenView:
    """What a frame shows, from the full scene's planes (H, W): depth weighted by alpha, and alpha."""
    shown = np.where(alpha > SKY_ALPHA, depth / np.maximum(alpha, SKY_ALPHA), np.inf)
    return SeenView(camera, shown.astype(np.float32), hidden)


def _pixels(camera: Camera, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, NDArray[np.int64]]:
    """Rows, columns and depths of the points that lie in the picture, and which those are."""
    pixel, depth = camera.project(points)
    inside = (depth > 1e-6) & (pixel >= 0).all(axis=1) & (pixel[:, 0] < camera.width) & (pixel[:, 1] < camera.height)
    index = np.flatnonzero(inside)
    return pixel[index, 1].astype(np.int64), pixel[index, 0].astype(np.int64), depth[index], index


def places_seen(points: Array, views: Sequence[SeenView]) -> Mask:
    """(P,) bool, whether some view shows the place (P, 3), world, and not something in front of it."""
    seen = np.zeros(len(points), dtype=bool)
    for view in views:
        open_ = np.flatnonzero(~seen)
        if not len(open_):
            break
        row, column, depth, index = _pixels(view.camera, points[open_])
        shows = ~view.hidden[row, column] & (view.depth[row, column] > (1 - AGREEMENT) * depth)
        seen[open_[index[shows]]] = True
    return seen


def sky_seen(directions: Array, views: Sequence[SeenView]) -> Mask:
    """(P,) bool, whether some view shows sky in the direction (P, 3), world."""
    seen = np.zeros(len(directions), dtype=bool)
    for view in views:
        row, column, _, index = _pixels(view.camera, view.camera.centre + 1e6 * directions)
        sky = ~view.hidden[row, column] & np.isinf(view.depth[row, column])
        seen[index[sky]] = True
    return seen


def never_seen(
    camera: Camera, hidden: Mask, alpha_left: NDArray[np.float32], depth_left: NDArray[np.float32], ground_depth: Array,
    views: Sequence[SeenView],
) -> Mask:  # fmt: skip
    """Pixels (H, W) of a removed object behind which lies what no frame shows.

    Args:
        camera: of the frame; hidden: (H, W), where it shows a removed object.
        alpha_left, depth_left: (H, W) of the scene without the removed; ground_depth: (H, W) of the ground, inf where none.
        views: all frames.
    """
    rays = camera.rays()[hidden]
    depth = np.where(alpha_left[hidden] > SURFACE, depth_left[hidden].astype(np.float64), np.inf)
    depth = np.minimum(depth, ground_depth[hidden])
    place = np.isfinite(depth)
    seen = np.zeros(len(rays), dtype=bool)
    seen[place] = places_seen(camera.centre + depth[place, None] * rays[place], views)
    seen[~place] = sky_seen(rays[~place], views)
    mask = np.zeros(hidden.shape, dtype=bool)
    mask[hidden] = ~seen
    return mask
