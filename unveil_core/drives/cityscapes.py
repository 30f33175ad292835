"""Cityscapes classes by number: trainIds, which drives carry on disk, and labelIds, which Cityscapes and KITTI-360 do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["CITYSCAPES", "LABEL_IDS", "VOID", "table", "train_id"]

CITYSCAPES: tuple[str, ...] = (
    "road",
    "sidewalk",
    "building",
    "wall",
    "fence",
    "pole",
    "traffic light",
    "traffic sign",
    "vegetation",
    "terrain",
    "sky",
    "person",
    "rider",
    "car",
    "truck",
    "bus",
    "train",
    "motorcycle",
    "bicycle",
)
"""Cityscapes class names; the position is the trainId."""

VOID = 255
"""The trainId of what has none."""

LABEL_IDS: dict[int, str] = {
    7: "road", 8: "sidewalk", 11: "building", 12: "wall", 13: "fence", 17: "pole", 19: "traffic light",
    20: "traffic sign", 21: "vegetation", 22: "terrain", 23: "sky", 24: "person", 25: "rider", 26: "car", 27: "truck",
    28: "bus", 31: "train", 32: "motorcycle", 33: "bicycle",
}  # fmt: skip
"""Cityscapes class names by labelId, of those that have a trainId."""


def train_id(name: str | None) -> int:
    """The trainId of a class name; 255 for None and for names that Cityscapes does not have."""
    return CITYSCAPES.index(name) if name in CITYSCAPES else VOID


def table(names: Mapping[int, str | None], size: int = 256) -> NDArray[np.uint8]:
    """(size,) trainId of each class number of a dataset, 255 where ``names`` has none: for look-ups by array."""
    found = np.full(size, VOID, dtype=np.uint8)
    for number, name in names.items():
        found[number] = train_id(name)
    return found
