# SPDX-License-Identifier: GPL-3.0-or-later
"""Class names and the colours that the field draws them in. No bpy here."""

from __future__ import annotations

import numpy as np

__all__ = ["CITYSCAPES", "VEHICLES", "color_of", "color_table"]

CITYSCAPES: dict[str, tuple[int, int, int]] = {
    "road": (128, 64, 128),
    "sidewalk": (244, 35, 232),
    "building": (70, 70, 70),
    "wall": (102, 102, 156),
    "fence": (190, 153, 153),
    "pole": (153, 153, 153),
    "traffic light": (250, 170, 30),
    "traffic sign": (220, 220, 0),
    "vegetation": (107, 142, 35),
    "terrain": (152, 251, 152),
    "sky": (70, 130, 180),
    "person": (220, 20, 60),
    "rider": (255, 0, 0),
    "car": (0, 0, 142),
    "truck": (0, 0, 70),
    "bus": (0, 60, 100),
    "train": (0, 80, 100),
    "motorcycle": (0, 0, 230),
    "bicycle": (119, 11, 32),
}
"""sRGB by name; the position is the number on disk."""
VEHICLES = ("car", "truck", "bus", "train", "motorcycle", "bicycle")
OTHER, UNKNOWN = (230, 120, 20), (95, 95, 95)
KEEP_REMOVE = ((110, 140, 110), (220, 40, 40))


def color_of(name: str) -> tuple[int, int, int]:
    """sRGB of a class; what people call otherwise is orange."""
    if name in ("keep", "remove"):
        return KEEP_REMOVE[name == "remove"]
    return CITYSCAPES.get(name, OTHER)


def color_table(source: str) -> np.ndarray:
    """(256, 3) uint8 by the number that stands for a class in the workspace, whose labels come from ``source``."""
    table = np.full((256, 3), UNKNOWN, np.uint8)
    known = list(CITYSCAPES.values()) if source == "semantics" else KEEP_REMOVE
    table[: len(known)] = known
    return table
