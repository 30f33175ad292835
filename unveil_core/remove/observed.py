"""Visibility of what lies behind removed objects: does any frame show it?

*3D StreetUnveiler*, section 3.2, takes the fall of alpha for the unobserved pixels. That calls sky behind a car unseen, and a
wall seen that shows far off through a gap. Here the surface that must be there is tested: the remaining scene, the continued
ground, or the sky, and whether some frame shows it without a removed object in front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import CameraViews
from unveil_core.remove.observed_kernels import DEPTHS, mark_shown, mark_sky

__all__ = ["SeenView", "SeenViews", "depth_behind", "never_seen", "places_seen", "seen_view", "sky_seen"]

AGREEMENT, GROUND_AGREEMENT, UNLABELLED_AGREEMENT = 0.1, 0.5, 0.25
"""Share of a point's depth by which the surface that a frame shows may be nearer and still not count as in front of the point:
the accuracy of rendered depth. Ground occludes a point only across a crest, so where the frame's label is ground more is allowed:
at a grazing angle its rendered depth is far less accurate. Unlabelled pixels get a value in between."""
AT_ONCE = 4096
"""Points that a thread takes at a time: some tens of microseconds."""
SKY_ALPHA, SURFACE = 0.3, 0.5
"""Alpha: a pixel of the full scene below the first shows sky, one of the empty scene above the second a surface."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """What a frame shows: how far it sees in each pixel.

    Attributes:
        max_visible_depth: (H, W) float16, depth along the optical axis beyond which points in a pixel are occluded, inf for none:
            its error is a hundredth of what the tests allow.
        sky: (H, W) bool, pixels that show sky.
        hidden: (H, W) bool, pixels that show a removed object.
    """

    max_visible_depth: NDArray[np.float16]
    sky: Mask
    hidden: Mask


SeenViews = CameraViews[SeenView]
"""What all frames of a drive show."""


def seen_view(
    depth: NDArray[np.float32],
    alpha: NDArray[np.float32],
    hidden: Mask,
    known_and_ground: tuple[Mask, Mask] | None = None,
) -> SeenView:
    """What a frame shows, from the full scene's planes (H, W): depth weighted by alpha, and alpha.

    Args:
        known_and_ground: (H, W) each, pixels whose labels are known, and those labelled ground; None for an unlabelled drive.
    """
    sky = alpha <= SKY_ALPHA
    reach = _pixel_reach(np.where(sky, np.inf, depth / np.maximum(alpha, SKY_ALPHA)))
    agreement = np.full(depth.shape, UNLABELLED_AGREEMENT)
    if known_and_ground is not None:
        known, ground = known_and_ground
        agreement[known] = np.where(ground, GROUND_AGREEMENT, AGREEMENT)[known]
    with np.errstate(over="ignore"):  # beyond 65 km is as far as can be
        return SeenView((reach / (1 - agreement)).astype(np.float16), sky, hidden)


def _pixel_reach(depth: NDArray[np.floating]) -> Float64:
    """(H, W) greatest depth that the surface at each pixel's centre has within that pixel.

    A pixel shows a patch, at a grazing angle metres of it, and its depth is that of one point. Over a plane inverse depth is
    linear in the picture, so the smaller of its slopes to the two neighbours, which at a depth edge is that of the same surface,
    gives how far the patch reaches.
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


def places_seen(points: Float64, views: SeenViews, place: Float64) -> Mask:
    """(P,) bool, whether some view shows the point (P, 3), world, and no surface in front of it.

    Args:
        place: (3,) near which frames are asked first.
    """
    points, seen = np.ascontiguousarray(points), np.zeros(len(points), dtype=np.uint8)
    for v in views.by_distance(views.near(points, ASKED_M), place):
        camera, view = views.cameras[v], views.frames[v]
        depth = view.max_visible_depth.view(np.uint16)
        in_parallel(
            mark_shown, len(points), AT_ONCE, points, seen, *camera.pose, camera.intrinsics, depth, view.hidden, DEPTHS
        )
        if seen.all():
            break
    return seen.astype(bool)


def sky_seen(directions: Float64, views: SeenViews, place: Float64) -> Mask:
    """(P,) bool, whether some view shows sky in the direction (P, 3), world.

    Args:
        place: (3,) near which frames are asked.
    """
    directions, seen = np.ascontiguousarray(directions), np.zeros(len(directions), dtype=np.uint8)
    for v in views.by_distance(views.near(place[None], ASKED_M), place) if len(directions) else ():
        camera, view = views.cameras[v], views.frames[v]
        turn, _ = camera.pose
        in_parallel(
            mark_sky, len(directions), AT_ONCE, directions, seen, turn, camera.intrinsics, view.sky, view.hidden
        )
        if seen.all():
            break
    return seen.astype(bool)


def depth_behind(
    remaining: tuple[NDArray[np.float32], NDArray[np.float32]],
    chart_depth: Float64,
    upright: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None,
    terrain_depth: Float64 | None = None,
) -> Float64:
    """(H, W) depth of the surface behind removed objects, inf for the sky.

    Where the terrain is known it ends every ray that no upright surface ends before: the terrain is as reliable as its points,
    while the surfels of the ground have holes where no frame looked. Elsewhere the nearer of the scene and the street's ground
    counts.

    Args:
        remaining: alpha and depth (H, W) of the scene without the removed objects.
        chart_depth: (H, W) of the street's ground, inf where none.
        upright: alpha and depth (H, W) of the surfels of that scene that do not lie on the ground; terrain_depth: (H, W), inf
            where none. Both or neither.
    """
    behind = np.minimum(_surface(*remaining), chart_depth)
    if upright is None or terrain_depth is None:
        return behind
    return np.minimum(_surface(*upright), np.where(np.isfinite(terrain_depth), terrain_depth, behind))


def _surface(alpha: NDArray[np.float32], depth: NDArray[np.float32]) -> Float64:
    return np.where(alpha > SURFACE, depth.astype(np.float64), np.inf)


def never_seen(camera: Camera, hidden: Mask, depth: Float64, views: SeenViews) -> Mask:
    """Pixels (H, W) of removed objects behind which lies a surface that no frame shows.

    Args:
        camera: of the frame; hidden: (H, W), where it shows a removed object.
        depth: (H, W) of that surface, see :func:`depth_behind`; views: all frames.
    """
    rays = camera.rays()[hidden]
    behind = depth[hidden]
    place = np.isfinite(behind)
    seen = np.zeros(len(rays), dtype=bool)
    seen[place] = places_seen(camera.centre + behind[place, None] * rays[place], views, camera.centre)
    seen[~place] = sky_seen(rays[~place], views, camera.centre)
    mask = np.zeros(hidden.shape, dtype=bool)
    mask[hidden] = ~seen
    return mask
