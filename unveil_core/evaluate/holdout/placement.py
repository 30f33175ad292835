"""Where on a street nothing stands, and a car would be well seen: places for virtual cars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask
from unveil_core.evaluate.holdout.virtual_cars import HEIGHT_M, LENGTH_M, WIDTH_M, VirtualCar, cast_car, paint_car, park
from unveil_core.geometry.camera import Camera
from unveil_core.ground.street import Ground
from unveil_core.raster import render
from unveil_core.surfels.surfels import Surfels

__all__ = ["CarPixels", "Sight", "find_places", "see_cars", "sight_of"]


SOLID = 0.5
STEP_S_M, STEP_L_M = 1.0, 0.3
"""Between places that are tried, along the street and across."""
ROOM_M = 0.25
"""Around the car, in which nothing may stand either."""
LOW_M = 0.3
"""Less than this above the ground is ground: kerbs, and its own roughness."""
THING_M = 0.7
"""What hides a car reaches higher than this: reconstructed ground on real footage may be off by half of that."""
CELL_M = 0.1
STRAYS = 2
"""So many surfels off the ground are no object yet."""
FLOOR_CELL_M, FLOOR_SHARE = 0.4, 0.6
"""The ground there must be known: surfels in this share of its cells."""
PATH_ROOM_M = 1.0
"""Between the car's side and the way of the camera, which may be on a car itself."""
COARSE_PX = 96
"""Width of the views in which places are compared."""
LEAST_SHARE, MOST_SHARE = 0.004, 0.35
"""Of a frame, that a car's pixels must have to count there, and that all cars together may have."""
LEAST_VISIBLE, LEAST_CLEAN = 0.6, 0.7
"""Share of the car that nothing hides, and of its visible pixels those that nothing real was removed from."""
ENOUGH_SHARE = 0.06
"""Of a frame; a car that is larger in it counts no more."""
FARTHEST_M = 50.0
"""From farther away no frame is asked."""
LEAST_FRAMES = 3
APART_M = 7.0


@dataclass(frozen=True, eq=False)
class Sight:
    """What a frame really shows.

    Attributes:
        camera: its camera.
        depth: (H, W) along the optical axis of what is there, inf for the sky.
        barred: (H, W), where the photograph is not the empty street: something real was removed, or its shadow.
    """

    camera: Camera
    depth: NDArray[np.floating]
    barred: Mask

    @cached_property
    def farthest(self) -> NDArray[np.floating]:
        """(H, W) the largest depth within a pixel around: ground seen at a grazing angle falls off steeply."""
        return cv2.dilate(self.depth, np.ones((3, 3), np.uint8)).astype(self.depth.dtype)

    def coarse(self, width: int) -> Sight:
        """About so wide, by leaving pixels out."""
        step = max(1, self.camera.width // width)
        depth, barred = (
            self.depth[step // 2 :: step, step // 2 :: step],
            self.barred[step // 2 :: step, step // 2 :: step],
        )
        camera, shift = self.camera, step // 2
        # The middle of a kept pixel stays where it is: x -> (x - 0.5 - shift) / step + 0.5.
        camera = replace(
            camera, width=depth.shape[1], height=depth.shape[0], fx=camera.fx / step, fy=camera.fy / step,
            cx=(camera.cx - 0.5 - shift) / step + 0.5, cy=(camera.cy - 0.5 - shift) / step + 0.5,
        )  # fmt: skip
        return Sight(camera, depth, barred)


@dataclass(frozen=True, eq=False)
class CarPixels:
    """The virtual cars as one frame would have shown them.

    Attributes:
        number: (H, W) uint8, 0 where no car is seen, else whose pixel it is.
        depth: (H, W) of the cars where they are seen, inf elsewhere.
        color: (H, W, 3) uint8.
    """

    number: NDArray[np.uint8]
    depth: NDArray[np.floating]
    color: NDArray[np.uint8]


def sight_of(surfels: Surfels, camera: Camera, barred: Mask, *, near: float, far: float) -> Sight:
    """The median depth of a scene with everything in it."""
    with torch.no_grad():
        out = render(surfels, camera, ("alpha", "median_depth"), near=near, far=far)
    assert out.alpha is not None and out.median_depth is not None
    return Sight(camera, np.where(out.alpha.numpy() > SOLID, out.median_depth.numpy(), np.float32(np.inf)), barred)


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


def _visible(car: VirtualCar, sight: Sight) -> tuple[tuple[slice, slice], Float64, Mask] | None:
    """The window of a car, its depth there, and which of its pixels nothing nearer hides."""
    window = _window(car, sight.camera)
    if window is None:
        return None
    rays = sight.camera.rays()[window]
    hits = cast_car(car, sight.camera.centre, rays.reshape(-1, 3))
    depth = hits.depth.reshape(rays.shape[:2])
    there = sight.depth[window]
    # Low in front of the car, and yet on a ray that meets it above its floor, is nothing but the ground's own roughness;
    # at a grazing angle a bump of a hand's breadth comes nearer by half a metre. A thing reaches higher somewhere.
    with np.errstate(invalid="ignore"):
        above = (sight.camera.centre - car.centre) @ car.axes[2] + there * (rays @ car.axes[2])
    before = (there < depth - 0.1) & (above > LOW_M)
    count, part = cv2.connectedComponents(before.astype(np.uint8), connectivity=8)
    things = np.zeros(count, dtype=bool)
    things[np.unique(part[before & (above > THING_M)])] = True
    return window, depth, np.isfinite(depth) & ~things[part]


def see_cars(cars: Sequence[VirtualCar], sight: Sight) -> CarPixels:
    """The cars in a frame, behind what stands nearer."""
    shape = sight.depth.shape
    number, nearest = np.zeros(shape, dtype=np.uint8), np.full(shape, np.inf, dtype=np.float32)
    color = np.zeros((*shape, 3), dtype=np.uint8)
    for car in cars:
        found = _visible(car, sight)
        if found is None:
            continue
        window, depth, seen = found
        # Single surfels astray in front of it are no things.
        whole = cv2.morphologyEx(seen.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        whole = cv2.morphologyEx(whole, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(bool)
        seen = whole & np.isfinite(depth) & (depth < nearest[window])
        rays = sight.camera.rays()[window][seen]
        hits = cast_car(car, sight.camera.centre, rays)
        color[window][seen] = paint_car(car, sight.camera.centre, rays, hits)
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
    """Street coordinates at which a car would stand on known ground, and on nothing else."""
    street = ground.path.to_street(points)
    above = ground.over(street)
    track = ground.path.to_street(np.stack([c.centre for c in cameras]))
    s_low, s_high = track[:, 0].min() + 2.0, track[:, 0].max() + 25.0
    s_high = min(s_high, ground.s_start + ground.s_cell * (len(ground.left) - 1))
    l_low, l_high = float(ground.right.min()), float(ground.left.max())
    if s_high <= s_low or l_high - l_low < WIDTH_M:
        return []

    def counted(s: Float64, l: Float64, cell: float) -> NDArray[np.float32]:  # noqa: E741
        rows, columns = int((s_high - s_low + 12.0) / cell) + 1, int((l_high - l_low + 8.0) / cell) + 1
        i, j = ((s - s_low + 6.0) / cell).astype(int), ((l - l_low + 4.0) / cell).astype(int)
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
        for l in np.arange(l_low, l_high, STEP_L_M):  # noqa: E741
            if (np.abs(track[beside, 1] - l) < WIDTH_M / 2 + PATH_ROOM_M).any():
                continue
            rim = np.array([-1.0, -1, 1, 1]) * LENGTH_M / 2, np.array([-1.0, 1, -1, 1]) * WIDTH_M / 2
            if not ground.inside(s + rim[0], l + rim[1]).all():
                continue
            i, j = (int((s - s_low + 6.0) / fine), int((l - l_low + 4.0) / fine))
            m, n = (int((s - s_low + 6.0) / coarse), int((l - l_low + 4.0) / coarse))
            if standing[i, j] <= STRAYS and known[m, n] >= FLOOR_SHARE * cells[m, n]:
                places.append((float(s), float(l)))
    return places


def _standing(ground: Ground, points: Float64) -> Float64:
    """(N, 2) street coordinates of the points above the ground, and no higher than a car's roof and the room above it."""
    street = ground.path.to_street(points)
    above = ground.over(street)
    return street[(above > LOW_M) & (above < HEIGHT_M + ROOM_M), :2]


def _value(car: VirtualCar, sights: Sequence[Sight]) -> tuple[float, NDArray[np.float64]]:
    """How well a place is seen, and its share of each frame (F,); 0 where it is seen by too few."""
    shares, cleaned = np.zeros(len(sights)), np.zeros(len(sights))
    good = np.zeros(len(sights), dtype=bool)
    for i, sight in enumerate(sights):
        if np.linalg.norm(sight.camera.centre - car.centre) > FARTHEST_M:
            continue
        found = _visible(car, sight)
        if found is None:
            continue
        window, depth, seen = found
        whole, visible = int(np.isfinite(depth).sum()), int(seen.sum())
        clean = int((seen & ~sight.barred[window]).sum())
        shares[i], cleaned[i] = visible / sight.depth.size, clean / sight.depth.size
        good[i] = (
            cleaned[i] >= LEAST_SHARE and visible >= LEAST_VISIBLE * whole
            and clean >= LEAST_CLEAN * visible and shares[i] <= MOST_SHARE
        )  # fmt: skip
    if good.sum() < LEAST_FRAMES or (shares > MOST_SHARE).any():
        return 0.0, shares
    return float(np.minimum(cleaned[good], ENOUGH_SHARE).sum()), shares


def find_places(
    ground: Ground, surfels: Surfels, measured: Float64, sights: Sequence[Sight], *, count: int,
    progress: Progress = no_progress,
) -> list[VirtualCar]:  # fmt: skip
    """The best seen places for cars on ground where nothing stands, the best one first.

    Args:
        ground: of the drive; surfels: the scene with everything in it.
        measured: (P, 3) LiDAR or SfM points.
        sights: what each frame shows, in the order of travel.
        count: how many are wanted; fewer come back where there is no room for more.
    Raises:
        WorkspaceError: there is no room for a single one.
    """
    opaque = surfels.opacity_logits.numpy() > -1.0
    places = _free_places(ground, surfels.means.double().numpy()[opaque], [s.camera for s in sights], measured)
    coarse = [s.coarse(COARSE_PX) for s in sights]
    valued: list[tuple[float, int, VirtualCar, NDArray[np.float64]]] = []
    for k, (s, l) in enumerate(places):  # noqa: E741
        car = park(ground, s, l, number=1)
        value, shares = _value(car, coarse)
        if value > 0:
            valued.append((value, k, car, shares))
        progress(k + 1, len(places), "looking for room for a car")
    chosen: list[VirtualCar] = []
    total = np.zeros(len(sights))
    for _, _, car, shares in sorted(valued, key=lambda v: (-v[0], v[1])):
        near = any(np.linalg.norm(car.centre - other.centre) < APART_M for other in chosen)
        if len(chosen) < count and not near and (total + shares <= MOST_SHARE).all():
            chosen.append(replace(car, number=len(chosen) + 1))
            total += shares
    if not chosen:
        seen = "nowhere beside the path is a car's length and width of ground free" if not places else (
            f"of {len(places)} free places none is well seen by {LEAST_FRAMES} frames"
        )  # fmt: skip
        raise WorkspaceError(
            f"there is no room for a virtual car: {seen}", mend="give a drive with more frames or open ground beside it"
        )
    return chosen
