"""Classes of every pixel of the street: points are seeds, and the photograph says how far each of them reaches."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc
from unveil_core.ground.height_field import HeightField
from unveil_core.labelling.sky import find_sky
from unveil_core.labelling.street_points import GROUND_IDS, StreetPoints, nearest_known
from unveil_core.semantics.classes import THIN_CLASSES
from unveil_core.semantics.visibility import PointsInView, points_in_view

__all__ = ["StreetView", "street_classes", "view_street"]

SMOOTHNESS, COLOR_SIGMA = 200.0, 10.0
"""Of the edge-preserving smoother that carries classes from seeds to pixels: how far, and over which steps of colour (of 255)."""
GROUND_TO, SKY_FROM = 0.02, 0.0
"""Rays rise by no more than this a metre where the ground may be, and by more where the sky may."""
OBSTACLE_M = 0.3
"""Points of the street higher than this over the ground, metres, may stand before an object."""
FAR_M = 150.0
"""The ground is looked up in the plan as far as this, metres."""
BEHIND_M = 1.0
"""Points of upright things so far behind others beside them, metres, and 5 % of their depth, are hidden."""
NOWHERE_M = 1e6
"""Stands for the depth of nothing, metres."""
THIN_WEIGHT = 1.0
"""Points on poles and signs count so much: they are few, and the smoother would give their pixels to what lies behind."""
GRID_PX, REACH_PX = 4, 4
"""The ground that the plan knows is a seed every so many pixels, unless something upright before it is nearer than so many."""
DENSITY_PX, FEWEST = 25, 10.0
"""Seeds weigh against their own density in squares of so many pixels, as if at least so many lay in each: one may be a mistake."""
SKY, BUILDING, ROAD, POLE = train_id("sky"), train_id("building"), train_id("road"), train_id("pole")
VEGETATION = train_id("vegetation")
THIN_IDS = tuple(train_id(name) for name in THIN_CLASSES)


@dataclass(frozen=True, eq=False)
class StreetView:
    """What a view shows of the points of the street.

    Attributes:
        seen: the points that the street itself does not hide.
        upright: (H, W) depth of those over the ground, metres, inf where there are none.
        rise: (H, W) metres that the pixels' rays rise a metre along the optical axis.
        places: (H, W, 2) x and y where the rays meet the ground, NaN where they do not.
        ground: (H, W) their depth there, inf where they do not.
        open_ground: (H, W) where points lie on the ground, and none stands before it.
    """

    seen: PointsInView
    upright: Float32
    rise: Float64
    places: Float64
    ground: Float64
    open_ground: Mask


def view_street(street: StreetPoints, camera: Camera) -> StreetView:
    """See the points of the street from a camera."""
    normals = street.normals.copy()
    # Leaves have no surface: each hides what is behind it, from wherever it is seen.
    leaves = street.classes == VEGETATION
    toward = camera.centre - street.positions[leaves]
    normals[leaves] = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-9)
    seen = points_in_view(street.positions, street.spacing, camera, near=NEAR_M, normals=normals)
    upright = np.full((camera.height, camera.width), np.inf, np.float32)
    high = ~(street.over[seen.index] < OBSTACLE_M)
    np.minimum.at(upright, (seen.rows[high], seen.columns[high]), seen.depth[high].astype(np.float32))
    rays = camera.rays()
    depth = np.full(upright.shape, np.inf)
    places = np.full((*upright.shape, 2), np.nan)
    open_ground = np.zeros(upright.shape, dtype=bool)
    if street.ground is not None:
        depth = _ground_depth(street.ground, camera)
        met = np.isfinite(depth)
        places[met] = camera.centre[:2] + rays[met][:, :2] * depth[met][:, None]
        if street.plan is not None:
            open_ground[met] = street.plan.known_at(places[met])
            open_ground &= _around(upright) > depth
    return StreetView(seen, upright, rays[..., 2], places, depth, open_ground)


def _ground_depth(ground: HeightField, camera: Camera) -> Float64:
    """(H, W) depth of the ground, inf where rays do not meet it; met at half the size, for that costs most of all."""
    coarse = camera.resized(max(camera.width // 2, 1), max(camera.height // 2, 1))
    found = ground.depth(coarse, coarse.rays()[..., 2] < GROUND_TO, near=NEAR_M, far=FAR_M)
    size = (camera.width, camera.height)
    met = cv2.resize(np.isfinite(found).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    # Of a plane the inverse of the depth is linear in the picture.
    inverse = cv2.resize(1 / found, size, interpolation=cv2.INTER_LINEAR)
    met &= inverse > 1 / FAR_M
    return np.where(met, 1 / np.where(met, inverse, 1.0), np.inf)


def _around(upright: Float32) -> Float32:
    """(H, W) least depth within ``REACH_PX``, very far where there is none."""
    nearest: Float32 = np.minimum(cv2.erode(upright, disc(REACH_PX)), NOWHERE_M)
    return nearest


def street_classes(
    image: NDArray[np.uint8], camera: Camera, street: StreetPoints, view: StreetView, objects: Mask
) -> NDArray[np.uint8]:
    """(H, W) trainIds of what stays, also behind objects, where they are guesses.

    Args:
        image: (H, W, 3) uint8; objects: (H, W) pixels that show removable objects.
    """
    seeds = view.seen.outside(objects)
    classes = street.classes[seeds.index]
    on_ground = np.isin(classes, GROUND_IDS)
    # Points of a wall behind a tree shine through between its leaves' own.
    front = seeds.depth <= _around(view.upright)[seeds.rows, seeds.columns] * 1.05 + BEHIND_M
    sky, solid, thin = find_sky(image, view.rise > SKY_FROM, seeds, objects)
    marks = {
        int(number): _weighed(_seeds(seeds, front & (classes == number), image.shape))
        for number in np.unique(classes[~on_ground & (classes != VOID)])
    }
    for number, found in ((BUILDING, solid), (POLE, thin)):
        marks[number] = np.maximum(marks.get(number, np.zeros_like(found)), found)
    earth = _seeds(seeds, on_ground, image.shape)
    # Where points showed the ground, it is seen wherever nothing upright stands before it.
    earth[::GRID_PX, ::GRID_PX][(view.open_ground & ~objects)[::GRID_PX, ::GRID_PX]] = 1
    guide = cv2.GaussianBlur(image, (3, 3), 0)
    smoother = cv2.ximgproc.createFastGlobalSmootherFilter(guide, SMOOTHNESS, COLOR_SIGMA)
    best = _spread(smoother, _weighed(earth))
    best[view.rise > GROUND_TO] = 0
    label = np.full(image.shape[:2], ROAD, np.uint8)
    for number, mark in sorted(marks.items()):
        value = _spread(smoother, mark) * (THIN_WEIGHT if number in THIN_IDS else 1.0)
        label[value > best] = number
        best = np.maximum(best, value)
    value = _spread(smoother, sky)
    value[view.rise <= SKY_FROM] = 0
    label[value > best] = SKY
    nothing = np.maximum(value, best) <= 1e-9
    label[nothing] = np.where(view.rise > GROUND_TO, BUILDING, ROAD)[nothing]
    _split_ground(label, view, street)
    return label


def _seeds(seen: PointsInView, which: Mask, shape: tuple[int, ...]) -> Float32:
    image = np.zeros(shape[:2], np.float32)
    image[seen.rows[which], seen.columns[which]] = 1.0
    return image


def _weighed(seeds: Float32) -> Float32:
    """Seeds that count the more the fewer of them lie around: else classes would win by being measured densely."""
    density = cv2.blur(seeds, (DENSITY_PX, DENSITY_PX))
    return seeds / np.maximum(density, FEWEST / DENSITY_PX**2)


def _spread(smoother: cv2.ximgproc.FastGlobalSmootherFilter, seeds: Float32) -> Float32:
    """How strongly seeds reach each pixel."""
    return smoother.filter(seeds) if seeds.any() else np.zeros_like(seeds)


def _split_ground(label: NDArray[np.uint8], view: StreetView, street: StreetPoints) -> None:
    """Give ground pixels the class of the plan where their rays meet the ground, in place."""
    if street.plan is None:
        return
    own = np.isin(label, GROUND_IDS)
    met = own & np.isfinite(view.ground)
    label[met] = street.plan.at(view.places[met])
    lost = own & ~met
    if lost.any() and met.any():
        label[lost] = nearest_known(label, met)[lost]
