"""Where an object touches the ground: the lower edge of its pixels in a frame, projected to the ground."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.ground.height_field import HeightField

__all__ = ["Contacts", "find_contacts"]

FAR_M = 300.0
"""Farther along a ray no contact is looked for; one pixel there is tens of metres of ground."""
WHEELBASE_M = 3.0
"""Metres. Between two wheels the lower edge shows a car's floor, not its contact with the ground."""
MOST_COLUMNS = 160
LEAST_HEIGHT_M = 0.35
"""An object lower than this over its contact, metres, is only a sliver of one."""


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts with the ground in one frame, one a column.

    Attributes:
        columns: (M,) pixels.
        points: (M, 3) places on the ground, world.
        depth: (M,) along the optical axis, metres.
        error: (M,) by which a pixel more or less moves the place, metres.
        height: (M,) of the object there, taken as upright over the contact, metres.
    """

    columns: NDArray[np.int64]
    points: Float64
    depth: Float64
    error: Float64
    height: Float64

    def __len__(self) -> int:
        return len(self.columns)

    def where(self, keep: Mask) -> Contacts:
        """Some of them."""
        return Contacts(self.columns[keep], self.points[keep], self.depth[keep], self.error[keep], self.height[keep])


def find_contacts(mask: Mask, below: Mask, camera: Camera, ground: HeightField) -> Contacts:
    """Contacts of the pixels of one object, or of several that touch in the image.

    A column counts where ground is seen right under it: not at the image's edge, nor where another object occludes it.

    Args:
        mask: (H, W) pixels; below: (H, W) pixels that show ground.
    """
    height = len(mask)
    columns = np.flatnonzero(mask.any(axis=0))
    lowest = height - 1 - mask[::-1, columns].argmax(axis=0)
    tall = mask[:, columns].sum(axis=0)
    under = np.minimum(lowest[:, None] + np.array([1, 2, 3]), height - 1)
    open_below = below[under, columns[:, None]].sum(axis=1) >= 2
    usable = open_below & (lowest < height - 4)
    if len(columns) > MOST_COLUMNS:
        usable &= np.isin(np.arange(len(columns)), np.linspace(0, len(columns) - 1, MOST_COLUMNS).astype(int))
    if not usable.any():
        return Contacts(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0))
    pixels = np.stack([columns + 0.5, lowest + 1.0], axis=1)[usable]
    rays = camera.rays_at(pixels)
    depth = ground.first_met(camera.centre, rays, near=NEAR_M, far=FAR_M)
    known = np.isfinite(depth)
    # Only what reaches as far down as its surroundings within a wheelbase stands on the ground.
    typical = float(np.median(depth[known])) if known.any() else 1.0
    span = int(np.clip(WHEELBASE_M * camera.fx / typical, 1, camera.width)) | 1
    row = np.full(camera.width, -1.0, np.float32)
    row[columns] = lowest
    closed = cv2.morphologyEx(row[None], cv2.MORPH_CLOSE, np.ones((1, span), np.uint8))[0]
    known &= closed[columns[usable]] - lowest[usable] <= 1
    depth = depth[known]
    points = camera.centre + depth[:, None] * rays[known]
    eye = np.maximum((camera.centre - points) @ ground.axes[2], 0.2)
    size = tall[usable][known] * depth / camera.fy
    found = Contacts(columns[usable][known], points, depth, depth**2 / (eye * camera.fy), size)
    return found.where(size > LEAST_HEIGHT_M)
