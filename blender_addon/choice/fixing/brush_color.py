# SPDX-License-Identifier: GPL-3.0-or-later
"""The brush's colour when painting begins: that of what was filled, and not black."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from ...formats.open_safely import LARGEST_PICTURE, open_file
from ...scene import versions

__all__ = ["filled_color", "take_color"]


def take_color(context: bpy.types.Context, image: bpy.types.Image, removed: Path) -> None:
    """Give the brush of Image Editors the colour that the clean frame has where something was removed.

    Args:
        image: the copy that is painted on.
        removed: the frame's mask, white where something was removed; without one, the colour is that of the whole frame.
    """
    color = filled_color(image, removed)
    if color is not None:
        versions.set_brush_color(context.tool_settings, color)


def filled_color(image: bpy.types.Image, removed: Path) -> tuple[float, float, float] | None:
    """Red, green and blue, scene linear: the median of a picture where its mask is white; None where it has no pixels."""
    picture = _pixels(image)
    if picture is None or picture.shape[2] < 3:
        return None
    where = _mask(removed, picture.shape[:2])
    chosen = picture[where] if where is not None and where.any() else picture.reshape(-1, picture.shape[2])
    color = np.median(chosen[:, :3], axis=0)
    red, green, blue = (float(v) for v in (color if image.is_float else _linear(color)))
    return red, green, blue


def _linear(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _pixels(image: bpy.types.Image) -> np.ndarray | None:
    """(H, W, C), every so many of a large picture: a median needs no more."""
    width, height = image.size
    if not width or not height:
        return None
    found = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(found)
    step = max(1, max(width, height) // 1000)
    return found.reshape(height, width, image.channels)[::step, ::step]


def _mask(path: Path, size: tuple[int, int]) -> np.ndarray | None:
    """(H, W) bool where a mask is white, at the size of the picture; None where it cannot be read."""
    image = None
    with suppress(OSError, ValueError, RuntimeError):
        open_file(path, LARGEST_PICTURE).close()
        image = bpy.data.images.load(str(path), check_existing=False)
    if image is None:
        return None
    pixels = _pixels(image)
    bpy.data.images.remove(image)
    if pixels is None:
        return None
    rows, columns = (np.arange(n) * have // n for n, have in zip(size, pixels.shape[:2], strict=True))
    return np.asarray(pixels[rows][:, columns, 0] > 0.5)
