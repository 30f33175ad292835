"""Which of the places behind what is removed some other frame saw.

*3D StreetUnveiler*, section 3.2, takes the fall of alpha for what nobody saw. That calls sky behind a car unseen, and a wall
seen that shows far off through a gap. Here the place that must be there is asked for: what stands there and is left, the ground
as it goes on, or the sky, and whether a frame shows it that no removed object hides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera

__all__ = ["SeenView", "depth_behind", "never_seen", "places_seen", "seen_view", "sky_seen"]

AGREEMENT, GROUND_AGREEMENT, UNTOLD_AGREEMENT = 0.1, 0.5, 0.25
"""Share of its depth by which what a frame shows may be nearer than a place and still not be called in front of it: depth is
known so well. Ground stands in front of a place only across a crest, so where the frame's label says ground more is allowed:
seen at a grazing angle its rendered depth is far worse. Where no label tells, it is something between."""
SKY_ALPHA, SURFACE = 0.3, 0.5
"""A pixel of the full scene with less alpha shows sky, one of the empty scene with more shows a surface."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """What a frame shows.

    Attributes:
        camera: of the frame.
        limit: (H, W) float32, depth along the optical axis beyond which what lies in a pixel is hidden, inf where nothing hides.
        sky: (H, W) bool, pixels that show sky.
        hidden: (H, W) bool, pixels that show a removed object.
    """

    camera: Camera
    limit: NDArray[np.float32]
    sky: Mask
    hidden: Mask


def seen_view(
    camera: Camera, depth: NDArray[np.float32], alpha: NDArray[np.float32], hidden: Mask,
    told: tuple[Mask, Mask] | None = None,
) -> SeenView:  # fmt: skip
    """What a frame shows, from the full scene's planes (H, W): depth weighted by alpha, and alpha.

    Args:
        told: (H, W) each, pixels whose labels are known, and those that they call ground; None where no labels tell.
    """
    sky = alpha <= SKY_ALPHA
    limit = _pixel_reach(np.where(sky, np.inf, depth / np.maximum(alpha, SKY_ALPHA)))
    agreement = np.full(depth.shape, UNTOLD_AGREEMENT)
    if told is not None:
        known, ground = told
        agreement[known] = np.where(ground, GROUND_AGREEMENT, AGREEMENT)[known]
    return SeenView(camera, (limit / (1 - agreement)).astype(np.float32), sky, hidden)


def _pixel_reach(depth: NDArray[np.floating]) -> Float64:
    """(H, W) greatest depth that the surface at each pixel's centre has within that pixel.

    A pixel shows a patch, at a grazing angle metres of it, and its depth is that of one point. Over a plane inverse depth is
    linear in the picture, so its slope to the nearer of two neighbours, which across an edge of depth is that of the own side,
    says how far the patch reaches.
    """
    inverse = np.where(np.isfinite(depth), 1 / np.maximum(depth, 1e-9), 0.0)
    reach = inverse.copy()
    for axis in (0, 1):
        if inverse.shape[axis] < 2:
            continue
        step = np.abs(np.diff(inverse, axis=axis))
        aside = np.full_like(np.take(inverse, [0], axis), np.inf)
        reach -= 0.5 * np.minimum(np.concatenate([aside, step], axis), np.concatenate([step, aside], axis))
    # Nothing is seen beyond the horizon, but what lies just before it is as far as can be.
    return np.where(reach > 1e-9, 1 / np.maximum(reach, 1e-9), np.inf)


def _pixels(camera: Camera, points: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64], Float64, NDArray[np.int64]]:
    """Rows, columns and depths of the points that lie in the picture, and which those are."""
    pixel, depth = camera.project(points)
    index = np.flatnonzero(camera.in_picture(pixel, depth))
    return pixel[index, 1].astype(np.int64), pixel[index, 0].astype(np.int64), depth[index], index


def places_seen(points: Float64, views: Sequence[SeenView]) -> Mask:
    """(P,) bool, whether some view shows the place (P, 3), world, and not something in front of it."""
    seen = np.zeros(len(points), dtype=bool)
    for view in views:
        open_ = np.flatnonzero(~seen)
        if not len(open_):
            break
        row, column, depth, index = _pixels(view.camera, points[open_])
        shows = ~view.hidden[row, column] & (view.limit[row, column] > depth)
        seen[open_[index[shows]]] = True
    return seen


def sky_seen(directions: Float64, views: Sequence[SeenView]) -> Mask:
    """(P,) bool, whether some view shows sky in the direction (P, 3), world."""
    seen = np.zeros(len(directions), dtype=bool)
    for view in views:
        row, column, _, index = _pixels(view.camera, view.camera.centre + 1e6 * directions)
        sky = ~view.hidden[row, column] & view.sky[row, column]
        seen[index[sky]] = True
    return seen


def depth_behind(
    left: tuple[NDArray[np.float32], NDArray[np.float32]], chart_depth: Float64,
    standing: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None, terrain_depth: Float64 | None = None,
) -> Float64:  # fmt: skip
    """(H, W) depth of what lies behind the removed, inf for the sky.

    Where the terrain is known it ends every ray that nothing standing ends before: it is as sure as its points, while the
    surfels of the ground have holes where nobody looked. Elsewhere the nearer of the scene and the street's chart counts.

    Args:
        left: alpha and depth (H, W) of the scene without the removed.
        chart_depth: (H, W) of the street's ground, inf where none.
        standing: alpha and depth (H, W) of what of it does not lie on the ground; terrain_depth: (H, W), inf where none.
            Both or neither.
    """
    behind = np.minimum(_surface(*left), chart_depth)
    if standing is None or terrain_depth is None:
        return behind
    return np.minimum(_surface(*standing), np.where(np.isfinite(terrain_depth), terrain_depth, behind))


def _surface(alpha: NDArray[np.float32], depth: NDArray[np.float32]) -> Float64:
    return np.where(alpha > SURFACE, depth.astype(np.float64), np.inf)


def never_seen(camera: Camera, hidden: Mask, depth: Float64, views: Sequence[SeenView]) -> Mask:
    """Pixels (H, W) of a removed object behind which lies what no frame shows.

    Args:
        camera: of the frame; hidden: (H, W), where it shows a removed object.
        depth: (H, W) of what lies behind, see :func:`depth_behind`; views: all frames.
    """
    rays = camera.rays()[hidden]
    behind = depth[hidden]
    place = np.isfinite(behind)
    seen = np.zeros(len(rays), dtype=bool)
    seen[place] = places_seen(camera.centre + behind[place, None] * rays[place], views)
    seen[~place] = sky_seen(rays[~place], views)
    mask = np.zeros(hidden.shape, dtype=bool)
    mask[hidden] = ~seen
    return mask
