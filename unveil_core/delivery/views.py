"""What the frames of a drive show of the empty street, at working size: the look-ups of delivery."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import CameraViews
from unveil_core.ground.street import Ground

__all__ = [
    "NEAREST_M",
    "SAME_DEPTH",
    "EmptyDepth",
    "EmptyView",
    "EmptyViews",
    "PlacesBehind",
    "choose_sources",
    "ground_before",
    "others_near",
    "places_behind",
    "sees",
]

SAME_DEPTH = 0.03
"""Share of its depth by which a place may lie before or behind what a view shows there and be it all the same."""
ASKED = 1500
"""Places of a hole by which sources are chosen."""
MOST_ASKED_VIEWS, MOST_LOOKS = 96, 480
"""Views that are compared at most, of those that show the hole the nearest in space, and views that are looked at for them: more of
a long drive show nothing else, but of a rig most cameras near by look elsewhere."""
LEAST_GAIN = 0.01
"""Share of a hole that a further source has to add."""
FINER = 1.6
"""A source that is so many times finer than the view counts as no better: what it shows is smoothed anyway."""

ON_GROUND = 0.05
"""Share of its depth by which what the scene shows may lie before the ground and be the ground."""
NEAREST_M = 0.1
"""Depth in front of which a camera shows nothing, metres."""


@dataclass(frozen=True, eq=False)
class EmptyDepth:
    """The empty scene in one frame.

    Attributes:
        camera: of working size.
        depth: (H, W) of the empty scene, see :func:`unveil_core.view.surface.surface_depth`.
    """

    camera: Camera
    depth: Float32


@dataclass(frozen=True, eq=False)
class EmptyView(EmptyDepth):
    """The same, with what the photograph is no witness of.

    Attributes:
        barred: (H, W) bool, pixels that show something that goes, its shadow, or what is no street.
    """

    barred: Mask

    def at(self, positions: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns (N,) of positions (N, 2) that lie in the picture."""
        column = np.clip(positions[:, 0].astype(np.int64), 0, self.camera.width - 1)
        return np.clip(positions[:, 1].astype(np.int64), 0, self.camera.height - 1), column


EmptyViews = CameraViews[EmptyView]
"""All frames of a drive."""


def others_near(views: EmptyViews, own: int) -> list[int]:
    """The other frames within ``ASKED_M``, those whose cameras are nearest to that of frame ``own`` first."""
    here = views.centres[own]
    return [int(j) for j in views.by_distance(views.near(here[None], ASKED_M), here) if j != own]


def sees(view: EmptyView, points: Float64, on_ground: Mask | None = None) -> tuple[NDArray[np.int64], Float64, Float64]:
    """Which world points (P, 3) a view shows, itself and not what is before it.

    Args:
        on_ground: (P,) points that lie on the ground itself, behind which nothing is seen: there the scene, whose surfels may lie
            a little under it or be missing, only tells what is before it.
    Returns:
        their indices (N,), rising; their pixels (N, 2); their depth (N,).
    """
    index, pixels, depth = view.camera.shown(points, nearest=NEAREST_M)
    row, column = view.at(pixels)
    shown = view.depth[row, column]
    seen = np.abs(shown - depth) < SAME_DEPTH * depth
    if on_ground is not None:
        seen |= on_ground[index] & ((shown == 0) | (shown > (1 - ON_GROUND) * depth))
    seen &= ~view.barred[row, column]
    return index[seen], pixels[seen], depth[seen]


def choose_sources(points: Float64, own: int, views: EmptyViews, most: int, on_ground: Mask | None = None) -> list[int]:
    """Frames that together show most of some places, and finest.

    Args:
        points: (P, 3) behind the hole of frame ``own``.
        most: frames at most.
        on_ground: (P,) as :func:`sees` takes it.
    Returns:
        indices, the best first.
    """
    if not len(points):
        return []
    step = max(1, len(points) // ASKED)
    points, on_ground = points[::step], None if on_ground is None else on_ground[::step]
    here = views.cameras[own]
    own_size = here.project(points)[1] / here.fx
    asked: list[int] = []
    quality = []
    for j in others_near(views, own)[:MOST_LOOKS]:
        if len(asked) == MOST_ASKED_VIEWS:
            break
        camera = views.cameras[j]
        if not len(camera.shown(points, nearest=NEAREST_M)[0]):
            continue
        seen, _, depth = sees(views.frames[j], points, on_ground)
        if not len(seen):
            continue
        finer = own_size[seen] / np.maximum(depth / camera.fx, 1e-9)
        # A view from far aside shows other sides of things.
        apart = float(np.linalg.norm(camera.centre - here.centre))
        aside = 1.0 / (1.0 + apart / np.maximum(depth, 1.0))
        asked.append(j)
        quality.append(np.zeros(len(points)))
        quality[-1][seen] = np.minimum(finer, FINER) * aside
    chosen: list[int] = []
    best = np.zeros(len(points))
    while quality and len(chosen) < most:
        gain = [float(np.maximum(q - best, 0).mean()) for q in quality]
        k = int(np.argmax(gain))
        if gain[k] < LEAST_GAIN:
            break
        chosen.append(asked[k])
        best = np.maximum(best, quality[k])
    return chosen


@dataclass(frozen=True, eq=False)
class PlacesBehind:
    """What lies behind N positions of a frame.

    Attributes:
        depth: (N,) along the optical axis, 0 for the sky; points: (N, 3), the camera's centre there.
        on_ground: (N,) bool; street: (N, 3) street coordinates of where the rays meet the ground, zero where they do not.
    """

    depth: Float64
    points: Float64
    on_ground: Mask
    street: Float64


def places_behind(camera: Camera, rays: Float64, depth: Float64, ground: Ground | None) -> PlacesBehind:
    """The places that rays of a camera meet: on the ground by the ground itself, elsewhere by the empty scene.

    Args:
        rays: (N, 3) world directions with unit component along the optical axis.
        depth: (N,) of the empty scene, 0 where it has no surface; ground: None where there is none.
    """
    street, on_ground = np.zeros((len(rays), 3)), np.zeros(len(rays), dtype=bool)
    if ground is not None:
        met, street = ground.intersect(camera, rays)
        on_ground = ground_before(np.where(np.isfinite(met), met, 0), depth)
        depth = np.where(on_ground, met, depth)
    return PlacesBehind(depth, camera.centre + depth[:, None] * rays, on_ground, street)


def ground_before(met: Float64, depth: Float64) -> Mask:
    """(N,) which rays show the ground.

    Args:
        met: (N,) depth at which they meet it, 0 where they do not; depth: (N,) of the empty scene, 0 where it has no surface.
    """
    shown: Mask = (met > 0) & ((depth == 0) | (met - depth < ON_GROUND * met))
    return shown
