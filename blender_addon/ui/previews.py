# SPDX-License-Identifier: GPL-3.0-or-later
"""Small pictures for the lists: a chip in each class's colour, and the thumbnails of objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import bpy.utils.previews

from ..formats.classes import color_of

__all__ = ["chip", "plain_chip", "thumbnail"]

_previews: Any = None
CHIP_PX = 16


def chip(class_name: str) -> int:
    """Icon number of a class's colour; 0 where there are no icons."""
    return plain_chip(f"class {class_name}", [c / 255 for c in color_of(class_name)])


def plain_chip(key: str, color: Sequence[float]) -> int:
    """Icon number of a color, sRGB from 0 to 1; 0 where there are no icons."""
    if _previews is None:
        return 0
    if key not in _previews:
        made = _previews.new(key)
        edge = {0, CHIP_PX - 1}
        pixels = [
            v
            for y in range(CHIP_PX)
            for x in range(CHIP_PX)
            for v in ((0.75, 0.75, 0.75, 1.0) if x in edge or y in edge else (*color, 1.0))
        ]
        made.icon_size = (CHIP_PX, CHIP_PX)
        made.icon_pixels_float = pixels
    return int(_previews[key].icon_id)


def thumbnail(path: str, stamp: str) -> int:
    """Icon number of a picture file, read anew where its stamp is another; 0 where there is none."""
    if _previews is None or not path or not stamp:
        return 0
    key = f"{path} {stamp}"
    if key not in _previews:
        _previews.load(key, path, "IMAGE")
    return int(_previews[key].icon_id)


def register() -> None:
    global _previews
    _previews = bpy.utils.previews.new()


def unregister() -> None:
    global _previews
    if _previews is not None:
        bpy.utils.previews.remove(_previews)
        _previews = None
