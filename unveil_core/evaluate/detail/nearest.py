"""Values continued from where they are known."""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask

__all__ = ["from_nearest"]

Value = TypeVar("Value", bound=np.generic)


def from_nearest(values: NDArray[Value], known: Mask) -> NDArray[Value]:
    """(H, W) values, of which pixels that are not ``known`` (H, W) take that of the nearest one that is; as they are if none is."""
    if known.all() or not known.any():
        return values
    _, number = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_number = np.zeros(int(number.max()) + 1, dtype=values.dtype)
    of_number[number[known]] = values[known]
    return of_number[number]
