"""Pictures without their lens, for programs that know pinhole cameras alone and take the principal point for the middle.

The focal length stays. Of the picture a rectangle around the principal point is kept in which every pixel is known, the largest
there is. Footage without a lens is cropped by whole pixels and nothing else, so that its pixels stay bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.drives.drive import Distortion
from unveil_core.drives.importing.frames import distortion_maps
from unveil_core.geometry.camera import Camera

__all__ = ["Pinhole", "pinhole_of"]

KEPT_LENSES = 4
"""Lenses whose look-ups are kept, 8 bytes a pixel."""


@dataclass(frozen=True, eq=False)
class Pinhole:
    """How the pictures of a camera become those of a pinhole.

    Attributes:
        camera: of the new pictures, with the pose of the old one.
        part: rows and columns of the old picture that are kept, where it has no lens.
        maps: look-ups of the new picture's pixels in the old one, where it has a lens.
    """

    camera: Camera
    part: tuple[slice, slice] | None = None
    maps: tuple[Float32, Float32] | None = None

    def of(self, picture: NDArray[Any]) -> NDArray[Any]:
        """The new picture of an old one (H, W) or (H, W, C), 8 or 16 bits."""
        if self.part is not None:
            return picture[self.part]
        assert self.maps is not None
        return cv2.remap(picture, *self.maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def pinhole_of(camera: Camera, lens: Distortion | None) -> Pinhole:
    """The largest pinhole picture around the principal point of a camera; ``lens``: None for none."""
    if lens is None:
        columns, rows = _around(camera.cx, camera.width), _around(camera.cy, camera.height)
        cropped = replace(
            camera,
            width=columns.stop - columns.start,
            height=rows.stop - rows.start,
            cx=camera.cx - columns.start,
            cy=camera.cy - rows.start,
        )
        return Pinhole(cropped, part=(rows, columns))
    numbers, maps = _of_lens(camera.intrinsics, lens)
    width, height, fx, fy, cx, cy = numbers
    return Pinhole(Camera(width, height, fx, fy, cx, cy, camera.world_to_camera), maps=maps)


def _around(middle: float, length: int) -> slice:
    """The longest run of whole pixels whose middle is within a quarter of a pixel of a position; all where the position is not in
    the picture."""
    if not 0 < middle < length:
        return slice(0, length)
    off = round(2 * middle - length)  # twice how far the position is from the middle
    return slice(max(off, 0), length + min(off, 0))


@lru_cache(maxsize=KEPT_LENSES)
def _of_lens(
    numbers: tuple[int, int, float, float, float, float], lens: Distortion
) -> tuple[tuple[int, int, float, float, float, float], tuple[Float32, Float32]]:
    """Numbers of the pinhole camera, and its look-ups in the pictures with the lens."""
    width, height, fx, fy, cx, cy = numbers
    half_width, half_height = (max(1, math.ceil(max(c, side - c))) for c, side in ((cx, width), (cy, height)))
    source = Camera(*numbers, np.eye(4))
    whole = Camera(2 * half_width, 2 * half_height, fx, fy, half_width, half_height, np.eye(4))
    columns, rows = distortion_maps(source, lens, whole)
    known = (columns >= 0) & (columns <= width - 1) & (rows >= 0) & (rows <= height - 1) & _unfolded(columns, rows)
    x, y = _largest(known)
    part = slice(half_height - y, half_height + y), slice(half_width - x, half_width + x)
    kept = (np.ascontiguousarray(columns[part]), np.ascontiguousarray(rows[part]))
    return (2 * x, 2 * y, fx, fy, float(x), float(y)), kept


def _unfolded(columns: Float32, rows: Float32) -> Mask:
    """(H, W) where look-ups go the way of the pixels: beyond the reach of a lens' polynomial they come back."""
    (down_c, right_c), (down_r, right_r) = np.gradient(columns), np.gradient(rows)
    return np.asarray(right_c * down_r - down_c * right_r > 0)


def _largest(known: Mask) -> tuple[int, int]:
    """Half the width and half the height of the largest rectangle around the middle of a mask (2 H, 2 W) that it holds whole; 1, 1
    at least."""
    known = known & known[::-1]
    known = known & known[:, ::-1]
    quarter = known[known.shape[0] // 2 :, known.shape[1] // 2 :]
    reach = np.where(quarter.all(axis=0), len(quarter), quarter.argmin(axis=0))
    reach = np.minimum.accumulate(reach)
    best = int(np.argmax(reach * np.arange(1, len(reach) + 1)))
    return best + 1, max(1, int(reach[best]))
