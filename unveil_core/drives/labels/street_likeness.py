"""How much pictures of classes look like a street: by it the meaning of numbers is found that several data sets use.

A street seen from a vehicle has the sky above, the ground below, and houses, trees and traffic amid them. Of the readings of a
picture's numbers the right one puts the sky on top; a wrong one lets people lie on the roofs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.cityscapes import CITYSCAPES, VOID

__all__ = ["SEEN_ON_STREETS", "street_likeness"]

BY_THIRD: dict[str, tuple[float, float, float]] = {
    "road": (0.002, 0.12, 0.60),
    "sidewalk": (0.002, 0.08, 0.16),
    "terrain": (0.005, 0.08, 0.12),
    "sky": (0.30, 0.03, 0.0005),
    "building": (0.32, 0.22, 0.02),
    "vegetation": (0.28, 0.22, 0.03),
    "wall": (0.02, 0.04, 0.01),
    "fence": (0.01, 0.04, 0.015),
    "pole": (0.03, 0.025, 0.008),
    "traffic light": (0.01, 0.003, 0.0003),
    "traffic sign": (0.01, 0.008, 0.001),
    "person": (0.001, 0.02, 0.01),
    "rider": (0.0005, 0.005, 0.002),
    "car": (0.004, 0.16, 0.08),
    "truck": (0.006, 0.02, 0.008),
    "bus": (0.006, 0.015, 0.004),
    "train": (0.002, 0.004, 0.002),
    "motorcycle": (0.0003, 0.006, 0.004),
    "bicycle": (0.0003, 0.008, 0.006),
}
"""About which share of the upper, middle and lower third of a picture from a vehicle each class has, as in Cityscapes: only its
order of magnitude counts."""
OF_VOID = 0.03
SEEN_ON_STREETS = -2.5
"""Mean logarithm of those shares over the pixels, from which on a reading is one of a street; label pictures of streets have -1 to
-2, of other readings of their numbers -3 to -6."""


def street_likeness(pictures: Sequence[NDArray[np.uint8]]) -> float:
    """Mean logarithm of how usual the class of each pixel is at its height; 0 is the most that could be.

    Args:
        pictures: (H, W) trainIds each, 255 void, of any size.
    """
    table = np.full((256, 3), np.log(OF_VOID))
    for name, shares in BY_THIRD.items():
        table[CITYSCAPES.index(name)] = np.log(shares)
    table[VOID] = np.log(OF_VOID)
    total = pixels = 0.0
    for picture in pictures:
        third = np.minimum(np.arange(len(picture)) * 3 // max(len(picture), 1), 2)
        total += float(table[picture, third[:, None]].sum())
        pixels += picture.size
    return total / pixels if pixels else -np.inf
