"""What is left of the removed objects: pixels of the clean frame that still show the crowded frame's colours."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Labels, Mask
from unveil_core.evaluate.detail.nearest import from_nearest

__all__ = ["PATCH_PX", "find_residue", "nearest_object"]

VISIBLE_LEVELS = 24.0
"""Residue is so far from the true street and more, root mean square of the channels: less passes as another shade of it. Of 24 and
32 the first finds the dark underside of cars that are left on asphalt in the shade."""
ALIKE_LEVELS = 16.0
"""Residue is no farther from the crowded frame, likewise. Without such a limit a wrong filling of a contrasting object's place
counts by chance: 15 % of what Telea fills in the parked street instead of 4 %."""
NEARER = 0.5
"""Residue is at most this share as far from the crowded frame as from the true street."""
PATCH_PX = 16
"""Smallest connected patch, pixels of 384x256."""


def find_residue(clean: Float32, crowded: Float32, truth: Float32, where: Mask, *, patch_px: int = 1) -> Mask:
    """Pixels (H, W) of ``where`` in patches that show what was to be removed, and not the street behind it.

    Where object and street have one colour nothing can be told, and nothing is found.

    Args:
        clean, crowded, truth: (H, W, 3) of :func:`unveil_core.geometry.images.smoothed`.
        where: (H, W) the removed region and its shadows.
        patch_px: pixels of the smallest patch that counts, see ``PATCH_PX``.
    """
    from_crowded, from_truth = _squared_distance(clean, crowded), _squared_distance(clean, truth)
    found = where & (from_truth >= VISIBLE_LEVELS**2)
    found &= (from_crowded <= ALIKE_LEVELS**2) & (from_crowded <= NEARER**2 * from_truth)
    if not found.any():
        return found
    _, number, boxes, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8), connectivity=8)
    large = boxes[:, cv2.CC_STAT_AREA] >= patch_px
    large[0] = False
    patches: Mask = large[number]
    return patches


def _squared_distance(one: Float32, other: Float32) -> Float32:
    """(H, W) mean of the squared differences of the channels."""
    difference = one - other
    return np.einsum("ijk,ijk->ij", difference, difference) / 3


def nearest_object(instances: Labels) -> Labels:
    """(H, W) the object that each pixel belongs to, for shadows and borders the nearest; 0 where the frame shows none.

    Args:
        instances: (H, W) ids of the removed objects, 0 none.
    """
    return from_nearest(instances, instances > 0)
