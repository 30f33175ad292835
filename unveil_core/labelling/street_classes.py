"""Classes of every pixel of the street: points are seeds, and the photograph says how far each of them reaches."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.labelling.sky import find_sky
from unveil_core.labelling.street_points import GROUND_IDS, StreetPoints
from unveil_core.semantics.classes import THIN_CLASSES
from unveil_core.semantics.visibility import PointsInView, points_in_view

__all__ = ["street_classes", "view_street"]

SMOOTHNESS, COLOR_SIGMA = 2000.0, 6.0
"""Of the edge-preserving smoother that carries classes from seeds to pixels: how far, and over which steps of colour (of 255)."""
GROUND_TO, SKY_FROM = 0.02, 0.0
"""Rays rise by no more than this a metre where the ground may be, and by more where the sky may."""
FAR_M = 150.0
"""The ground is looked up in the plan as far as this, metres."""
THIN_WEIGHT = 3.0
"""Points on poles and signs count so much: they are few, and the smoother would give their pixels to what lies behind."""
SKY, BUILDING, ROAD = train_id("sky"), train_id("building"), train_id("road")
THIN_IDS = tuple(train_id(name) for name in THIN_CLASSES)


def view_street(street: StreetPoints, camera: Camera) -> PointsInView:
    """The points of the street that a view sees, as far as the street itself hides them."""
    return points_in_view(street.positions, street.spacing, camera, near=NEAR_M, normals=street.normals)


def street_classes(
    image: NDArray[np.uint8], camera: Camera, street: StreetPoints, seen: PointsInView, objects: Mask
) -> NDArray[np.uint8]:
    """(H, W) trainIds of what stays, also behind objects, where they are guesses.

    Args:
        image: (H, W, 3) uint8; seen: points of the street in view; objects: (H, W) pixels that show removable objects.
    """
    rise = camera.rays()[..., 2]
    seeds = seen.outside(objects)
    classes = street.classes[seeds.index]
    sky = find_sky(image, rise > SKY_FROM, seeds, objects)
    names = [int(k) for k in np.unique(classes) if k != VOID and k not in GROUND_IDS]
    names = sorted({*names, BUILDING})
    guide = cv2.GaussianBlur(image, (3, 3), 0)
    smoother = cv2.ximgproc.createFastGlobalSmootherFilter(guide, SMOOTHNESS, COLOR_SIGMA)
    ground = _spread(smoother, _seeds(seeds, np.isin(classes, GROUND_IDS), image.shape))
    ground[rise > GROUND_TO] = 0
    ids, best, most = [ROAD], ground, np.zeros(image.shape[:2], np.uint8)
    for number in names:
        weight = THIN_WEIGHT if number in THIN_IDS else 1.0
        value = _spread(smoother, weight * _seeds(seeds, classes == number, image.shape))
        most[value > best] = len(ids)
        best = np.maximum(best, value)
        ids.append(number)
    value = _spread(smoother, sky)
    value[rise <= SKY_FROM] = 0
    most[value > best] = len(ids)
    best = np.maximum(best, value)
    ids.append(SKY)
    label = np.asarray(ids, np.uint8)[most]
    nothing = best <= 1e-9
    label[nothing] = np.where(rise > GROUND_TO, BUILDING, ROAD)[nothing]
    _split_ground(label, camera, street)
    return label


def _seeds(seen: PointsInView, which: Mask, shape: tuple[int, ...]) -> Float32:
    image = np.zeros(shape[:2], np.float32)
    image[seen.rows[which], seen.columns[which]] = 1.0
    return image


def _spread(smoother: cv2.ximgproc.FastGlobalSmootherFilter, seeds: Float32) -> Float32:
    if not seeds.any():
        return np.zeros_like(seeds)
    return smoother.filter(seeds)


def _split_ground(label: NDArray[np.uint8], camera: Camera, street: StreetPoints) -> None:
    """Give ground pixels the class of the plan where their rays meet the ground, in place."""
    if street.plan is None or street.ground is None:
        return
    own = np.isin(label, GROUND_IDS)
    depth = street.ground.depth(camera, own, near=NEAR_M, far=FAR_M)
    met = own & np.isfinite(depth)
    places: Float64 = camera.centre + camera.rays()[met] * depth[met][:, None]
    label[met] = street.plan.at(places[:, :2])
    lost = own & ~met
    if lost.any() and met.any():
        _, nearest = cv2.distanceTransformWithLabels(
            (~met).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        of_label = np.zeros(int(nearest.max()) + 1, np.uint8)
        of_label[nearest[met]] = label[met]
        label[lost] = of_label[nearest[lost]]
