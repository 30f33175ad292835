"""Which pixels of the true empty street show the ground.

Nothing here depends on what a run found out, so that two runs are measured on the same pixels.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.base.types import Mask
from unveil_core.drives.cityscapes import CITYSCAPES, VOID
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.detail.nearest import from_nearest
from unveil_core.evaluate.flicker import DepthGrid, read_depth
from unveil_core.evaluate.pictures import truth_file
from unveil_core.geometry.images import border_px, disc
from unveil_core.geometry.label_images import resize_labels
from unveil_core.semantics.classes import GROUND_CLASSES, REMOVABLE

__all__ = ["faces_up", "ground_pixels"]

GROUND_IDS = tuple(CITYSCAPES.index(name) for name in GROUND_CLASSES)
"""Cityscapes trainIds of ground."""
UNTOLD_IDS = (*(CITYSCAPES.index(name) for name in REMOVABLE), VOID)
"""Labels that say nothing of the street behind."""
UPWARD = 0.85
"""Smallest vertical component of the unit normal of ground, a slope of 32 degrees: steeper than any street. By depth of half the
picture's size 95 % of the ground of the sample scenes is tilted by less than 11 degrees."""
CLOSED_PX = 2
"""Gaps of the ground up to twice as wide are closed, pixels at 384 px: a kerb's face, the foot of a sign's pole."""
RIM_PX = 2
"""So far from what is not ground nothing is ground, pixels at 384 px: the foot of a facade is no line on the ground, and depth of
half the picture's size is off by a pixel there."""


def ground_pixels(truth: Path, frame: Frame, removed: Mask) -> Mask | None:
    """The pixels that show the ground once everything is removed, without their rim towards what is not ground.

    By ``truth/semantics`` (Cityscapes trainIds) where there is one, else by ``truth/depth``, else by the drive's own labels,
    continued into the removed region from the nearest pixel outside: about three quarters of a parked car's pixels are right so.

    Args:
        truth: folder of the truth; removed: (H, W) pixels that the drive's labels may call a removed object.
    Returns:
        (H, W), or None where none of the three is known.
    Raises:
        DriveError: a file that cannot be read.
    """
    height, width = removed.shape
    if (labels := truth_file(truth / "semantics", frame)) is not None:
        ground = np.isin(resize_labels(read_label_image(labels), (width, height)), GROUND_IDS)
    elif (depth := truth_file(truth / "depth", frame)) is not None:
        ground = faces_up(read_depth(depth, frame.camera))
    elif frame.semantic_path is not None:
        labels_of_drive = resize_labels(read_label_image(frame.semantic_path), (width, height))
        known = ~removed & ~np.isin(labels_of_drive, UNTOLD_IDS)
        ground = from_nearest(np.isin(labels_of_drive, GROUND_IDS), known)
    else:
        return None
    return cv2.erode(ground.astype(np.uint8), disc(border_px(width, RIM_PX))).astype(bool)


def faces_up(grid: DepthGrid) -> Mask:
    """(H, W) pixels whose surface is level and lies below the camera; narrow gaps are closed."""
    camera = grid.camera
    rows, columns = grid.pixels()
    depth = np.where(grid.depth > 0, grid.depth, np.nan)[..., None]
    # From the camera's place, each axis by itself: three planes of differences are faster than one array of vectors.
    x, y, z = np.moveaxis(depth * camera.rays()[np.ix_(rows, columns)], -1, 0)
    with np.errstate(invalid="ignore"):
        (ax, bx), (ay, by), (az, bz) = (np.gradient(plane) for plane in (x, y, z))
        level = ax * by - ay * bx
        found = level**2 >= UPWARD**2 * ((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + level**2)
        found &= z < 0
    found = found.repeat(grid.step, axis=0).repeat(grid.step, axis=1)
    closed = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_CLOSE, disc(border_px(camera.width, CLOSED_PX)))
    return closed.astype(bool)
