"""Between the footage, over which a person clicks and paints, and the picture of working size that objects are outlined in."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float64, Mask
from unveil_core.delivery.lens import picture_positions, work_positions
from unveil_core.drives.drive import Frame
from unveil_core.drives.importing.frames import at_work_size
from unveil_core.geometry.images import resampled
from unveil_core.geometry.lens import undistorted

__all__ = ["in_footage", "in_picture", "mask_in_picture", "seen_in_footage"]


def in_picture(frame: Frame, places: Float64) -> Float64:
    """(N, 2) where the working picture shows what the footage shows at places (N, 2), pixels from the outer corner."""
    assert frame.footage is not None
    source, lens, target = frame.footage.camera, frame.footage.distortion, frame.camera
    flat = (places - [source.cx, source.cy]) / [source.fx, source.fy]
    if lens is not None:
        flat = undistorted(lens.model, lens.coefficients, flat)
    return flat * [target.fx, target.fy] + [target.cx, target.cy]


def seen_in_footage(frame: Frame, shares: Float64) -> Float64:
    """(N, 2) where the footage shows what the camera sees without its lens at shares (N, 2) of its width and height."""
    assert frame.footage is not None
    work = (shares * [frame.camera.width, frame.camera.height]).astype(np.float32)
    return picture_positions(frame.footage, frame.camera, work).astype(np.float64)


def mask_in_picture(frame: Frame, mask: Mask) -> Mask:
    """(H, W) of the working picture, pixels of a mask (h, w) over the footage."""
    assert frame.footage is not None
    levels = (mask.astype(np.uint8) * 255)[..., None].repeat(3, axis=2)
    return np.asarray(at_work_size(levels, frame.footage, frame.camera)[..., 0] > 127)


def in_footage(frame: Frame, mask: Mask) -> Mask:
    """(h, w) of the footage, pixels of a mask (H, W) of the working picture."""
    assert frame.footage is not None
    size = (frame.footage.camera.height, frame.footage.camera.width)
    if mask.shape == size and frame.footage.distortion is None:
        return mask
    where = work_positions(frame.footage, frame.camera)
    # Softened to the larger pixels' size, so that the outline has no steps.
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.6)
    return np.asarray(resampled(soft, where, border=cv2.BORDER_CONSTANT) > 0.5)
