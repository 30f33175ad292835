"""Classes of every pixel of the street: points are seeds, and the photograph says how far each of them reaches."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc
from unveil_core.labelling.sky import find_sky
from unveil_core.labelling.street_points import GROUND_IDS, StreetPoints, nearest_known
from unveil_core.semantics.classes import THIN_CLASSES
from unveil_core.semantics.visibility import PointsInView, points_in_view

__all__ = ["street_classes", "view_street"]

SMOOTHNESS, COLOR_SIGMA = 200.0, 10.0
"""Of the edge-preserving smoother that carries classes from seeds to pixels: how far, and over which steps of colour (of 255)."""
GROUND_TO, SKY_FROM = 0.02, 0.0
"""Rays rise by no more than this a metre where the ground may be, and by more where the sky may."""
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


def view_street(street: StreetPoints, camera: Camera) -> PointsInView:
    """The points of the street that a view sees, as far as the street itself hides them."""
    normals = street.normals.copy()
    # Leaves have no surface: each hides what is behind it, from wherever it is seen.
    leaves = street.classes == VEGETATION
    toward = camera.centre - street.positions[leaves]
    normals[leaves] = toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-9)
    return points_in_view(street.positions, street.spacing, camera, near=NEAR_M, normals=normals)


def street_classes(
    image: NDArray[np.uint8], camera: Camera, street: StreetPoints, seen: PointsInView, objects: Mask
) -> NDArray[np.uint8]:
    """(H, W) trainIds of what stays, also behind objects, where they are guesses.

    Args:
        image: (H, W, 3) uint8; seen: points of the street in view; objects: (H, W) pixels that show removable objects.
    """
    rays = camera.rays()
    rise = rays[..., 2]
    seeds = seen.outside(objects)
    classes = street.classes[seeds.index]
    on_ground = np.isin(classes, GROUND_IDS)
    depth, plan = _ground_in_view(camera, rays, street)
    upright = _nearest_upright(seeds, ~on_ground, image.shape)
    # Points of a wall behind a tree shine through between its leaves' own.
    front = seeds.depth <= upright[seeds.rows, seeds.columns] * 1.05 + BEHIND_M
    sky, solid, thin = find_sky(image, rise > SKY_FROM, seeds, objects)
    marks = {
        int(number): _weighed(_seeds(seeds, front & (classes == number), image.shape))
        for number in np.unique(classes[~on_ground & (classes != VOID)])
    }
    for number, found in ((BUILDING, solid), (POLE, thin)):
        marks[number] = np.maximum(marks.get(number, np.zeros_like(found)), found)
    earth = _seeds(seeds, on_ground, image.shape)
    # Where points showed the ground, it is seen wherever nothing upright stands before it.
    open_ground = (plan != VOID) & ~objects & (upright > depth)
    earth[::GRID_PX, ::GRID_PX] = np.maximum(earth[::GRID_PX, ::GRID_PX], open_ground[::GRID_PX, ::GRID_PX])
    earth = _weighed(earth)
    guide = cv2.GaussianBlur(image, (3, 3), 0)
    smoother = cv2.ximgproc.createFastGlobalSmootherFilter(guide, SMOOTHNESS, COLOR_SIGMA)
    best = _spread(smoother, earth)
    best[rise > GROUND_TO] = 0
    label = np.full(image.shape[:2], ROAD, np.uint8)
    for number, mark in sorted(marks.items()):
        value = _spread(smoother, mark) * (THIN_WEIGHT if number in THIN_IDS else 1.0)
        label[value > best] = number
        best = np.maximum(best, value)
    value = _spread(smoother, sky)
    value[rise <= SKY_FROM] = 0
    label[value > best] = SKY
    nothing = np.maximum(value, best) <= 1e-9
    label[nothing] = np.where(rise > GROUND_TO, BUILDING, ROAD)[nothing]
    _split_ground(label, camera, rays, depth, street)
    return label


def _ground_in_view(camera: Camera, rays: Float64, street: StreetPoints) -> tuple[Float64, NDArray[np.uint8]]:
    """(H, W) depth of the ground, inf where there is none, and its class where points lie on it there, 255 elsewhere."""
    plan = np.full(rays.shape[:2], VOID, np.uint8)
    depth = np.full(rays.shape[:2], np.inf)
    if street.ground is None or street.plan is None:
        return depth, plan
    depth = street.ground.depth(camera, rays[..., 2] < GROUND_TO, near=NEAR_M, far=FAR_M)
    met = np.isfinite(depth)
    places = camera.centre[:2] + rays[met][:, :2] * depth[met][:, None]
    plan[met] = np.where(street.plan.known_at(places), street.plan.at(places), VOID)
    return depth, plan


def _nearest_upright(seen: PointsInView, which: Mask, shape: tuple[int, ...]) -> Float32:
    """(H, W) depth of the nearest point that is no ground within ``REACH_PX``, very far where there is none."""
    depth = np.full(shape[:2], np.inf, np.float32)
    np.minimum.at(depth, (seen.rows[which], seen.columns[which]), seen.depth[which].astype(np.float32))
    nearest: Float32 = np.minimum(cv2.erode(depth, disc(REACH_PX)), NOWHERE_M)
    return nearest


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


def _split_ground(
    label: NDArray[np.uint8], camera: Camera, rays: Float64, depth: Float64, street: StreetPoints
) -> None:
    """Give ground pixels the class of the plan where their rays meet the ground, in place."""
    if street.plan is None:
        return
    own = np.isin(label, GROUND_IDS)
    met = own & np.isfinite(depth)
    places = camera.centre[:2] + rays[met][:, :2] * depth[met][:, None]
    label[met] = street.plan.at(places)
    lost = own & ~met
    if lost.any() and met.any():
        label[lost] = nearest_known(label, met)[lost]
