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
from unveil_core.drives.depth_range import ASKED_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid
from unveil_core.geometry.reach import CameraViews
from unveil_core.remove.observed_kernels import DEPTHS, mark_shown, mark_sky

__all__ = ["SeenView", "SeenViews", "depth_behind", "never_seen", "seen_by_some", "seen_view"]

AGREEMENT, GROUND_AGREEMENT, UNLABELLED_AGREEMENT = 0.1, 0.5, 0.25
"""Share of a point's depth by which the surface that a frame shows may be nearer and still not count as in front of the point:
the accuracy of rendered depth. Ground occludes a point only across a crest, so where the frame's label is ground more is allowed:
at a grazing angle its rendered depth is far less accurate. Unlabelled pixels get a value in between."""
AT_ONCE = 4096
"""Points that a thread takes at a time: some tens of microseconds."""
FARTHEST_M = 60_000.0
"""Depth for surfaces that reach to the horizon, metres: half floats go to 65,504."""
CELL_M = 20.0
"""Side of the cells of the ground whose places are given up together where a frame cannot show them, metres."""
SKY_ALPHA = 0.3
"""Alpha of the full scene up to which a pixel shows the sky."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """What a frame shows: how far it sees in each pixel.

    Attributes:
        depth: (H, W) float16, depth along the optical axis beyond which points in a pixel are occluded; 0 where a removed object
            hides all, inf where the sky is seen. A half float's error is a hundredth of what the tests allow.
    """

    depth: NDArray[np.float16]

    @property
    def hidden(self) -> Mask:
        """(H, W) pixels that show a removed object."""
        nothing: Mask = self.depth == 0
        return nothing


SeenViews = CameraViews[SeenView]
"""What all frames of a drive show."""


def seen_view(
    depth: NDArray[np.float32],
    alpha: NDArray[np.float32],
    hidden: Mask,
    by_label: tuple[Mask, Mask, Mask] | None = None,
) -> SeenView:
    """What a frame shows, from the full scene's planes (H, W): depth weighted by alpha, and alpha.

    Args:
        by_label: (H, W) each, pixels whose labels are known, those labelled ground, and those labelled sky, which the scene may
            show through a haze of surfels; None for an unlabelled drive.
    """
    sky = alpha <= SKY_ALPHA
    if by_label is not None:
        sky |= by_label[2]
    reach = _pixel_reach(np.where(sky, np.inf, depth / np.maximum(alpha, SKY_ALPHA)))
    agreement = np.full(depth.shape, UNLABELLED_AGREEMENT)
    if by_label is not None:
        known, ground, _ = by_label
        agreement[known] = np.where(ground, GROUND_AGREEMENT, AGREEMENT)[known]
    farthest = np.clip(reach / (1 - agreement), NEAR_M, FARTHEST_M)
    return SeenView(np.where(hidden, 0.0, np.where(sky, np.inf, farthest)).astype(np.float16))


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


def seen_by_some(points: Float64, directions: Float64, views: SeenViews, place: Float64) -> tuple[Mask, Mask]:
    """(P,) bool, whether some view shows the point and no surface in front of it; (D,) bool, whether one shows sky there.

    Views are asked that may show something that none before has shown, and that are near: a place within ``ASKED_M`` of their
    camera, the sky if they are within that of ``place``.

    Args:
        points: (P, 3), world; directions: (D, 3), world.
        place: (3,) near which frames are asked first.
    """
    grid = PointGrid(points, CELL_M)
    points, directions = np.ascontiguousarray(points[grid.order]), np.ascontiguousarray(directions)
    shown, sky = np.zeros(len(points), dtype=np.uint8), np.zeros(len(directions), dtype=np.uint8)
    close = views.near(place[None], ASKED_M) if len(directions) else np.zeros(0, dtype=np.int64)
    asked = views.by_distance(np.union1d(views.near(points, ASKED_M), close), place)
    low, high = (
        extreme.reduceat(points, grid.first) if len(points) else points for extreme in (np.minimum, np.maximum)
    )
    may_show = views.may_show(asked, low, high, ASKED_M)
    may_show_sky = np.isin(asked, close)
    if len(directions):
        box = directions.min(axis=0)[None, None], directions.max(axis=0)[None, None]
        may_show_sky &= views.may_look(asked, *box)[:, 0]
    left, sky_left = np.ones(len(grid.first), dtype=bool), len(directions) > 0
    for k, v in enumerate(asked):
        ask_points, ask_sky = bool((may_show[k] & left).any()), bool(may_show_sky[k]) and sky_left
        if not (ask_points or ask_sky):
            continue
        camera, depth = views.cameras[v], views.frames[v].depth.view(np.uint16)
        turn, shift = camera.pose
        if ask_points:
            looks = turn, shift, camera.intrinsics, depth, DEPTHS
            in_parallel(mark_shown, len(points), AT_ONCE, points, shown, *looks)
            left = ~np.logical_and.reduceat(shown, grid.first)
        if ask_sky:
            in_parallel(mark_sky, len(directions), AT_ONCE, directions, sky, turn, camera.intrinsics, depth, DEPTHS)
            sky_left = not sky.all()
        if not (sky_left or left.any()):
            break
    seen = np.zeros(len(points), dtype=bool)
    seen[grid.order] = shown
    return seen, sky.astype(bool)


def depth_behind(
    remaining: NDArray[np.float32],
    chart_depth: Float64,
    upright: NDArray[np.float32] | None = None,
    terrain_depth: Float64 | None = None,
) -> Float64:
    """(H, W) depth of the surface behind removed objects, inf for the sky.

    Where the terrain is known it ends every ray that no upright surface ends before: the terrain is as reliable as its points,
    while the surfels of the ground have holes where no frame looked. Elsewhere the nearer of the scene and the street's ground
    counts.

    Args:
        remaining: (H, W) depth of the scene without the removed objects, 0 where it has no surface.
        chart_depth: (H, W) of the street's ground, inf where none.
        upright: (H, W) depth of the surfels of that scene that do not lie on the ground, 0 where there is none;
            terrain_depth: (H, W), inf where none. Both or neither.
    """
    behind = np.minimum(_surface(remaining), chart_depth)
    if upright is None or terrain_depth is None:
        return behind
    return np.minimum(_surface(upright), np.where(np.isfinite(terrain_depth), terrain_depth, behind))


def _surface(depth: NDArray[np.float32]) -> Float64:
    return np.where(depth > 0, depth.astype(np.float64), np.inf)


def never_seen(camera: Camera, hidden: Mask, depth: Float64, views: SeenViews) -> Mask:
    """Pixels (H, W) of removed objects behind which lies a surface that no frame shows.

    Args:
        camera: of the frame; hidden: (H, W), where it shows a removed object.
        depth: (H, W) of that surface, see :func:`depth_behind`; views: all frames.
    """
    rays = camera.rays()[hidden]
    behind = depth[hidden]
    place = np.isfinite(behind)
    points = camera.centre + behind[place, None] * rays[place]
    seen = np.zeros(len(rays), dtype=bool)
    seen[place], seen[~place] = seen_by_some(points, rays[~place], views, camera.centre)
    mask = np.zeros(hidden.shape, dtype=bool)
    mask[hidden] = ~seen
    return mask
