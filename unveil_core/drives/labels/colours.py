"""Label pictures in colours: the colours that the field draws street classes in, and those of ADE20K.

Cityscapes, Mapillary Vistas and CARLA draw the same thing in the same colour where they have it, so they are one table.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.cityscapes import VOID, train_id

__all__ = ["COLOUR_ORDERS", "packed", "train_ids_of_colours"]

Colour = tuple[int, int, int]
STREET: dict[Colour, str | None] = {
    (128, 64, 128): "road", (244, 35, 232): "sidewalk", (70, 70, 70): "building", (102, 102, 156): "wall",
    (190, 153, 153): "fence", (153, 153, 153): "pole", (250, 170, 30): "traffic light", (220, 220, 0): "traffic sign",
    (107, 142, 35): "vegetation", (152, 251, 152): "terrain", (70, 130, 180): "sky", (220, 20, 60): "person",
    (255, 0, 0): "rider", (0, 0, 142): "car", (0, 0, 70): "truck", (0, 60, 100): "bus", (0, 80, 100): "train",
    (0, 0, 230): "motorcycle", (119, 11, 32): "bicycle",
    # Cityscapes' classes without a trainId
    (0, 0, 0): None, (111, 74, 0): None, (81, 0, 81): None, (250, 170, 160): "road", (230, 150, 140): "road",
    (180, 165, 180): "fence", (150, 100, 100): "building", (150, 120, 90): "building", (0, 0, 90): "truck",
    (0, 0, 110): "truck",
    # Mapillary Vistas
    (165, 42, 42): None, (0, 192, 0): None, (196, 196, 196): "sidewalk", (90, 120, 150): "fence", (128, 64, 255): "road",
    (140, 140, 200): "road", (170, 170, 170): "sidewalk", (96, 96, 96): "sidewalk", (110, 110, 110): "road",
    (255, 0, 100): "rider", (255, 0, 200): "rider", (200, 128, 128): "road", (255, 255, 255): "road",
    (64, 170, 64): "terrain", (230, 160, 50): "terrain", (190, 255, 255): None, (0, 170, 30): None,
    (255, 255, 128): None, (250, 0, 30): None, (100, 140, 180): None, (220, 220, 220): None, (220, 128, 128): "road",
    (222, 40, 40): None, (100, 170, 30): None, (40, 40, 40): None, (33, 33, 33): None, (100, 128, 160): "road",
    (142, 0, 0): None, (70, 100, 150): "road", (210, 170, 100): "pole", (128, 128, 128): "pole", (0, 0, 80): "pole",
    (192, 192, 192): "traffic sign", (140, 140, 20): None, (150, 0, 255): None, (128, 64, 64): "car", (0, 0, 192): None,
    (32, 32, 32): None, (120, 10, 10): None,
    # CARLA
    (100, 40, 40): "fence", (157, 234, 50): "road", (110, 190, 160): None, (170, 120, 50): None, (45, 60, 150): None,
    (55, 90, 80): None, (145, 170, 100): "terrain",
}  # fmt: skip
"""The Cityscapes class by colour (sRGB), None of what has none."""
ADE20K: dict[Colour, str | None] = {
    (120, 120, 120): "wall", (180, 120, 120): "building", (6, 230, 230): "sky", (4, 200, 3): "vegetation",
    (140, 140, 140): "road", (4, 250, 7): "terrain", (235, 255, 7): "sidewalk", (150, 5, 61): "person",
    (120, 120, 70): "terrain", (204, 255, 4): "vegetation", (0, 102, 200): "car", (255, 9, 224): "building",
    (112, 9, 255): "terrain", (255, 184, 6): "fence", (255, 61, 6): "fence", (255, 5, 153): "traffic sign",
    (160, 150, 20): "terrain", (255, 31, 0): "sidewalk", (153, 255, 0): "road", (255, 82, 0): "building",
    (255, 0, 0): "vegetation", (255, 102, 0): "terrain", (0, 82, 255): "vegetation", (255, 0, 255): "building",
    (255, 0, 245): "bus", (255, 0, 20): "truck", (255, 184, 184): "building", (0, 71, 255): "pole", (0, 10, 255): "terrain",
    (51, 0, 255): "pole", (0, 194, 255): "terrain", (163, 255, 0): "car", (163, 0, 255): "motorcycle",
    (255, 245, 0): "bicycle", (41, 0, 255): "traffic light", (0, 0, 0): None,
}  # fmt: skip
"""Of those of its 150 colours that mean a Cityscapes class; skyscrapers have that of roads, which are more."""
COLOUR_ORDERS: dict[str, Mapping[Colour, str | None]] = {"cityscapes-colours": STREET, "ade20k-colours": ADE20K}
"""Tables of colours by the name that they are given by."""
NEAREST = 30
"""A pixel of a lossy picture has a table's colour if it is no farther from it, in levels of all channels together; beyond, at the
borders of classes, it is of neither. Of all colours there are, a fifth is so near to one of the table."""
CELL_BITS = 5
"""Of each channel, that a look-up of nearest colours tells apart: 8 levels, a quarter of the distance above."""


def packed(pixels: NDArray[np.integer]) -> NDArray[np.int64]:
    """(H, W) or (N,) numbers of colours (H, W, 3) or (N, 3): red * 65536 + green * 256 + blue."""
    red, green, blue = (pixels[..., k].astype(np.int64) for k in range(3))
    return (red << 16) | (green << 8) | blue


def train_ids_of_colours(
    pixels: NDArray[np.uint8], order: str, *, lossy: bool
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Trainids of a picture in colours.

    Args:
        pixels: (H, W, 3) RGB.
        order: one of :data:`COLOUR_ORDERS`.
        lossy: the colours are only nearly those of the table.
    Returns:
        (H, W) trainIds, 255 void; and (H, W) which pixels have a colour of the table.
    """
    if lossy:
        cells = _cells(order)
        shift = 8 - CELL_BITS
        red, green, blue = (pixels[..., k].astype(np.int32) >> shift for k in range(3))
        found = cells[(red << 2 * CELL_BITS) | (green << CELL_BITS) | blue]
        return (found & 0xFF).astype(np.uint8), found < NONE
    keys, ids = _table(order)
    numbers = packed(pixels)
    at = np.searchsorted(keys, numbers).clip(max=len(keys) - 1)
    known = keys[at] == numbers
    return np.where(known, ids[at], VOID).astype(np.uint8), known


NONE = 256
"""Of a cell that no colour of the table is near to: this and void."""


@lru_cache(maxsize=4)
def _table(order: str) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Colours as :func:`packed` has them, ascending, and their trainIds."""
    names = COLOUR_ORDERS[order]
    keys = packed(np.array(list(names)))
    ids = np.array([train_id(name) for name in names.values()], np.uint8)
    by = np.argsort(keys)
    return keys[by], ids[by]


@lru_cache(maxsize=4)
def _cells(order: str) -> NDArray[np.uint16]:
    """The trainId of the nearest colour by cell of the colour cube, :data:`NONE` more where none is near."""
    keys, ids = _table(order)
    colours = np.stack([keys >> 16, (keys >> 8) & 255, keys & 255], axis=1)
    side = 1 << CELL_BITS
    middle = np.arange(side) * (256 // side) + 128 // side
    cube = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    apart = np.abs(cube - colours).sum(axis=2)
    nearest = apart.argmin(axis=1)
    near = np.take_along_axis(apart, nearest[:, None], axis=1)[:, 0] <= NEAREST
    return np.where(near, ids[nearest].astype(np.uint16), np.uint16(NONE | VOID))
