"""Free places on a street where a virtual car would be well visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask
from unveil_core.evaluate.holdout.virtual_cars import HEIGHT_M, LENGTH_M, WIDTH_M, VirtualCar, cast_car, paint_car, park
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, disc, grow
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.street import Ground
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import scene_depth

__all__ = [
    "COARSE_PX",
    "MOST_SHARE",
    "CarPixels",
    "Place",
    "SceneView",
    "Visibility",
    "find_places",
    "ground_shown",
    "scene_view",
    "see_cars",
    "seen_places",
]


STEP_S_M, STEP_T_M = 1.0, 0.3
"""Distance of the places that are tried, along the street and across, metres."""
ROOM_M = 0.25
"""Width of the free margin around the car, metres."""
LOW_M = 0.3
"""Less than this above the ground, metres, is ground: kerbs and roughness."""
GROUND_SHARE = 0.02
"""So much farther from the ground, as a share of its distance, a pixel still shows it: depth of far pixels is less sure."""
RIM_PX = 2
"""So far from what is no ground nothing is, pixels at 384 px: the foot of a facade is no line on the ground."""
THING_M = 0.7
"""An object that occludes a car reaches higher than this, metres: reconstructed ground on real footage may be off by half of it."""
CELL_M = 0.1
STRAYS = 2
"""Up to so many surfels above the ground do not count as an object."""
FLOOR_CELL_M, FLOOR_SHARE = 0.4, 0.6
"""The ground there must be known: surfels in this share of its cells."""
PATH_ROOM_M = 1.0
"""Between the car's side and the path of the camera, which may be on a car itself, metres."""
COARSE_PX = 96
"""Width of the views in which places are compared."""
LEAST_SHARE, MOST_SHARE = 0.004, 0.35
"""Share of a frame that a car must cover to count there, and that all cars together may cover."""
LEAST_VISIBLE, LEAST_CLEAN = 0.6, 0.7
"""Least share of the car that must be unoccluded, and of its visible pixels from which nothing real was removed."""
ENOUGH_SHARE = 0.06
"""Share of a frame; a car that covers more of it counts no more."""
FARTHEST_M = 50.0
"""Frames farther from a place than this, metres, are not considered."""
LEAST_FRAMES = 3
APART_M = 7.0


@dataclass(frozen=True, eq=False)
class SceneView:
    """The real scene as one frame shows it.

    Attributes:
        camera: of the frame.
        depth: (H, W) along the optical axis, inf for the sky.
        excluded: (H, W), where the photograph is not the empty street: something real was removed, or its shadow.
    """

    camera: Camera
    depth: NDArray[np.floating]
    excluded: Mask

    @cached_property
    def farthest(self) -> NDArray[np.floating]:
        """(H, W) the largest depth within a pixel around: ground seen at a grazing angle falls off steeply."""
        return cv2.dilate(self.depth, np.ones((3, 3), np.uint8)).astype(self.depth.dtype)

    def coarse(self, width: int) -> SceneView:
        """About so wide, by leaving pixels out."""
        step = max(1, self.camera.width // width)
        some = (slice(step // 2, None, step),) * 2
        depth, excluded = self.depth[some].copy(), self.excluded[some].copy()
        camera, shift = self.camera, step // 2
        # The middle of a kept pixel stays where it is: x -> (x - 0.5 - shift) / step + 0.5.
        camera = replace(
            camera,
            width=depth.shape[1],
            height=depth.shape[0],
            fx=camera.fx / step,
            fy=camera.fy / step,
            cx=(camera.cx - 0.5 - shift) / step + 0.5,
            cy=(camera.cy - 0.5 - shift) / step + 0.5,
        )
        return SceneView(camera, depth, excluded)


@dataclass(frozen=True, eq=False)
class CarPixels:
    """The virtual cars as one frame would show them.

    Attributes:
        number: (H, W) uint8, the number of the car that is visible, 0 = none.
        depth: (H, W) of the cars where they are seen, inf elsewhere.
        color: (H, W, 3) uint8.
    """

    number: NDArray[np.uint8]
    depth: NDArray[np.floating]
    color: NDArray[np.uint8]


def scene_view(surfels: Surfels, camera: Camera, excluded: Mask) -> SceneView:
    """The depth of a scene with everything in it."""
    depth = scene_depth(surfels, camera)
    return SceneView(camera, np.where(depth > 0, depth, np.float32(np.inf)), excluded)


def ground_shown(view: SceneView, ground: Ground, where: Mask) -> Mask:
    """(H, W) pixels of ``where`` in which the photograph shows the ground, without their rim towards what is none.

    Args:
        where: (H, W) the pixels that are asked for.
    """
    rim = border_px(view.camera.width, RIM_PX)
    asked = grow(where, rim)
    rows, columns = np.nonzero(asked & np.isfinite(view.depth))
    depth = view.depth[rows, columns].astype(np.float64)
    places = view.camera.centre + depth[:, None] * view.camera.rays()[rows, columns]
    above = ground.over(ground.path.to_street(places))
    # What is not asked for says nothing against its neighbours.
    shown = ~asked
    shown[rows, columns] = np.abs(above) < LOW_M + GROUND_SHARE * depth
    found: Mask = cv2.erode(shown.astype(np.uint8), disc(rim)).astype(bool) & where
    return found


def _window(car: VirtualCar, camera: Camera) -> tuple[slice, slice] | None:
    """Rows and columns that a car may cover; None where it is out of the picture."""
    pixel, depth = camera.project(car.corners())
    if (depth <= 0).all():
        return None
    low, high = np.zeros(2), np.array([camera.width, camera.height], dtype=np.float64)
    if (depth > 0.05).all():
        low, high = np.maximum(low, pixel.min(axis=0) - 2), np.minimum(high, pixel.max(axis=0) + 2)
    if (high <= low).any():
        return None
    (x0, y0), (x1, y1) = np.floor(low).astype(int), np.ceil(high).astype(int)
    return slice(int(y0), int(y1)), slice(int(x0), int(x1))


def _visible(car: VirtualCar, view: SceneView) -> tuple[tuple[slice, slice], Float64, Mask] | None:
    """The window of a car, its depth there, and which of its pixels nothing nearer hides."""
    window = _window(car, view.camera)
    if window is None:
        return None
    rays = view.camera.rays()[window]
    hits = cast_car(car, view.camera.centre, rays.reshape(-1, 3))
    depth = hits.depth.reshape(rays.shape[:2])
    there = view.depth[window]
    # Low in front of the car, and yet on a ray that meets it above its floor, is nothing but the ground's own roughness;
    # at a grazing angle a bump of a hand's breadth comes nearer by half a metre. A thing reaches higher somewhere.
    with np.errstate(invalid="ignore"):
        above = (view.camera.centre - car.centre) @ car.axes[2] + there * (rays @ car.axes[2])
    before = (there < depth - 0.1) & (above > LOW_M)
    count, part = cv2.connectedComponents(before.astype(np.uint8), connectivity=8)
    things = np.zeros(count, dtype=bool)
    things[np.unique(part[before & (above > THING_M)])] = True
    return window, depth, np.isfinite(depth) & ~things[part]


def see_cars(cars: Sequence[VirtualCar], view: SceneView) -> CarPixels:
    """The cars in a frame, occluded by what is nearer."""
    shape = view.depth.shape
    number, nearest = np.zeros(shape, dtype=np.uint8), np.full(shape, np.inf, dtype=np.float32)
    color = np.zeros((*shape, 3), dtype=np.uint8)
    for car in cars:
        found = _visible(car, view)
        if found is None:
            continue
        window, depth, seen = found
        # Single surfels astray in front of it are no things.
        whole = cv2.morphologyEx(seen.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        whole = cv2.morphologyEx(whole, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(bool)
        seen = whole & np.isfinite(depth) & (depth < nearest[window])
        rays = view.camera.rays()[window][seen]
        hits = cast_car(car, view.camera.centre, rays)
        color[window][seen] = paint_car(car, view.camera.centre, rays, hits)
        nearest[window][seen] = depth[seen]
        number[window][seen] = car.number
    if not number.any():
        # Most frames of a long drive: no memory for what says nothing.
        return CarPixels(number, np.broadcast_to(np.float32(np.inf), shape), np.broadcast_to(np.uint8(0), (*shape, 3)))
    return CarPixels(number, nearest, color)


# ------------------------------------------------------------------------------------------------------------ free places


def _free_places(
    ground: Ground, points: Float64, cameras: Sequence[Camera], measured: Float64
) -> list[tuple[float, float]]:
    """Street coordinates (s, t) at which a car would stand on known ground, and on nothing else."""
    street = ground.path.to_street(points)
    above = ground.over(street)
    track = ground.path.to_street(np.stack([c.centre for c in cameras]))
    s_low, s_high = track[:, 0].min() + 2.0, track[:, 0].max() + 25.0
    s_high = min(s_high, ground.s_start + ground.s_cell * (len(ground.t_max) - 1))
    t_low, t_high = float(ground.t_min.min()), float(ground.t_max.max())
    if s_high <= s_low or t_high - t_low < WIDTH_M:
        return []

    def counted(s: Float64, t: Float64, cell: float) -> NDArray[np.float32]:
        rows, columns = int((s_high - s_low + 12.0) / cell) + 1, int((t_high - t_low + 8.0) / cell) + 1
        i, j = ((s - s_low + 6.0) / cell).astype(int), ((t - t_low + 4.0) / cell).astype(int)
        keep = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        return (
            np.bincount(i[keep] * columns + j[keep], minlength=rows * columns).reshape(rows, columns).astype(np.float32)
        )

    def around(image: NDArray[np.float32], cell: float, margin: float) -> NDArray[np.float32]:
        sides = tuple(2 * round((side / 2 + margin) / cell) + 1 for side in (WIDTH_M, LENGTH_M))
        summed = cv2.boxFilter(image, -1, sides, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return summed.astype(np.float32)

    fine, coarse = CELL_M, FLOOR_CELL_M
    stands = np.concatenate([_standing(ground, points), _standing(ground, measured)])
    standing = around(counted(stands[:, 0], stands[:, 1], fine), fine, ROOM_M)
    floor_points = np.abs(above) < 0.5 * LOW_M
    floor = (counted(street[floor_points, 0], street[floor_points, 1], coarse) > 0).astype(np.float32)
    known, cells = around(floor, coarse, 0.0), around(np.ones_like(floor), coarse, 0.0)

    places = []
    for s in np.arange(s_low, s_high, STEP_S_M):
        beside = np.abs(track[:, 0] - s) < LENGTH_M / 2 + 1
        for t in np.arange(t_low, t_high, STEP_T_M):
            if (np.abs(track[beside, 1] - t) < WIDTH_M / 2 + PATH_ROOM_M).any():
                continue
            rim = np.array([-1.0, -1, 1, 1]) * LENGTH_M / 2, np.array([-1.0, 1, -1, 1]) * WIDTH_M / 2
            if not ground.inside(s + rim[0], t + rim[1]).all():
                continue
            i, j = (int((s - s_low + 6.0) / fine), int((t - t_low + 4.0) / fine))
            m, n = (int((s - s_low + 6.0) / coarse), int((t - t_low + 4.0) / coarse))
            if standing[i, j] <= STRAYS and known[m, n] >= FLOOR_SHARE * cells[m, n]:
                places.append((float(s), float(t)))
    return places


def _standing(ground: Ground, points: Float64) -> Float64:
    """(N, 2) street coordinates of the points above the ground, and no higher than a car's roof and the room above it."""
    street = ground.path.to_street(points)
    above = ground.over(street)
    return street[(above > LOW_M) & (above < HEIGHT_M + ROOM_M), :2]


@dataclass(frozen=True)
class Visibility:
    """How well a car must be seen to be worth a place.

    Attributes:
        least_share: of a frame, that it must cover to count there.
        least_clean: of its visible pixels, those from which nothing real was removed.
        most_share: of a frame, that it may cover in any.
    """

    least_share: float = LEAST_SHARE
    least_clean: float = LEAST_CLEAN
    most_share: float = MOST_SHARE


@dataclass(frozen=True, eq=False)
class Place:
    """A free place, and how a car there would be seen.

    Attributes:
        car: there, without a number of its own yet.
        value: shares of frames, summed up over those that show it well.
        near: (F,) indices of the frames near it; shares: (F,) of each, that it covers.
    """

    car: VirtualCar
    value: float
    near: NDArray[np.int64]
    shares: NDArray[np.float64]


def _seen(car: VirtualCar, views: Sequence[SceneView], centres: Float64, wanted: Visibility) -> Place:
    """How well a car is seen; its value is 0 where it is by too few frames.

    Args:
        views: of all frames; centres: (F, 3) of their cameras.
    """
    near = np.flatnonzero(np.linalg.norm(centres - car.centre, axis=1) <= FARTHEST_M)
    shares, cleaned = np.zeros(len(near)), np.zeros(len(near))
    good = np.zeros(len(near), dtype=bool)
    for i, v in enumerate(near):
        view = views[v]  # type: ignore[call-overload]
        found = _visible(car, view)
        if found is None:
            continue
        window, depth, seen = found
        whole, visible = int(np.isfinite(depth).sum()), int(seen.sum())
        clean = int((seen & ~view.excluded[window]).sum())
        shares[i], cleaned[i] = visible / view.depth.size, clean / view.depth.size
        good[i] = (
            cleaned[i] >= wanted.least_share
            and visible >= LEAST_VISIBLE * whole
            and clean >= wanted.least_clean * visible
            and shares[i] <= wanted.most_share
        )
    if good.sum() < LEAST_FRAMES or (shares > wanted.most_share).any():
        return Place(car, 0.0, near, shares)
    return Place(car, float(np.minimum(cleaned[good], ENOUGH_SHARE).sum()), near, shares)


def seen_places(
    ground: Ground,
    surfels: Surfels,
    measured: Float64,
    views: Sequence[SceneView],
    *,
    wanted: Visibility | None = None,
    progress: Progress = no_progress,
) -> list[Place]:
    """All well seen places for cars on ground where nothing stands, the best one first; they overlap.

    Args:
        ground: of the drive; surfels: the scene with everything in it.
        measured: (P, 3) LiDAR or SfM points.
        views: of all frames, in the order of travel.
        wanted: how well they must be seen.
    Raises:
        WorkspaceError: there is no such place.
    """
    wanted = wanted or Visibility()
    opaque = surfels.opacity_logits.numpy() > -1.0
    coarse = [s.coarse(COARSE_PX) for s in views]
    cameras = [s.camera for s in coarse]
    places = _free_places(ground, surfels.means.double().numpy()[opaque], cameras, measured)
    centres = centres_of(cameras)
    found: list[Place] = []
    for k, (s, t) in enumerate(places):
        place = _seen(park(ground, s, t, number=1), coarse, centres, wanted)
        if place.value > 0:
            found.append(place)
        progress(k + 1, len(places), "looking for room for a car")
    if not found:
        seen = (
            "nowhere beside the path is a car's length and width of ground free"
            if not places
            else (f"of {len(places)} free places none is well seen by {LEAST_FRAMES} frames")
        )
        raise WorkspaceError(
            f"No room for a virtual car: {seen}", mend="give a drive with more frames or open ground beside it"
        )
    return sorted(found, key=lambda place: -place.value)


def find_places(
    ground: Ground,
    surfels: Surfels,
    measured: Float64,
    views: Sequence[SceneView],
    *,
    count: int,
    progress: Progress = no_progress,
) -> list[VirtualCar]:
    """The best seen places for cars that do not cover each other's, the best one first.

    Args:
        ground, surfels, measured, views: as of :func:`seen_places`.
        count: how many are wanted; fewer come back where there is no room for more.
    Raises:
        WorkspaceError: there is no room for a single one.
    """
    chosen: list[VirtualCar] = []
    total = np.zeros(len(views))
    for place in seen_places(ground, surfels, measured, views, progress=progress):
        apart = all(np.linalg.norm(place.car.centre - other.centre) >= APART_M for other in chosen)
        if len(chosen) < count and apart and (total[place.near] + place.shares <= MOST_SHARE).all():
            chosen.append(replace(place.car, number=len(chosen) + 1))
            total[place.near] += place.shares
    return chosen
