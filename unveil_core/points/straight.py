"""Photographs without the distortion of their lens, at the size at which frames are compared."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.drives.drive import Distortion
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import FISHEYE
from unveil_core.points.cloud import WORK_PX

__all__ = ["Straightened", "straightened"]


@dataclass(frozen=True, eq=False)
class Straightened:
    """Attributes:
    camera: the pinhole of the pictures that are made.
    maps: (H, W, 2) where in a photograph each of their pixels is; None = it is only made smaller.
    outside: (H, W) pixels that no photograph shows; None = none.
    """

    camera: Camera
    maps: Float32 | None
    outside: Mask | None

    def picture(self, photograph: Picture) -> Picture:
        """(H, W, 3) of a photograph."""
        size = (self.camera.width, self.camera.height)
        if self.maps is None:
            if photograph.shape[1::-1] == size:
                return photograph
            return np.asarray(cv2.resize(photograph, size, interpolation=cv2.INTER_AREA), np.uint8)
        reduced = photograph.shape[1] / size[0]
        if reduced > 1.5:  # what is only sampled would alias
            photograph = np.asarray(cv2.GaussianBlur(photograph, (0, 0), 0.4 * reduced), np.uint8)
        return np.asarray(cv2.remap(photograph, self.maps[..., 0], self.maps[..., 1], cv2.INTER_LINEAR), np.uint8)

    def hidden(self, hidden: Mask | None) -> Mask | None:
        """(H, W) of the pixels of a photograph that are not to be used, and those that none shows."""
        if hidden is None:
            return self.outside
        size = (self.camera.width, self.camera.height)
        if self.maps is None:
            small = cv2.resize(hidden.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        else:
            small = cv2.remap(hidden.astype(np.uint8), self.maps[..., 0], self.maps[..., 1], cv2.INTER_NEAREST)
        found = np.asarray(small > 0)
        return found if self.outside is None else found | self.outside


def straightened(camera: Camera, lens: Distortion | None, longest: int = WORK_PX) -> Straightened:
    """How photographs of a camera are straightened.

    Args:
        camera: the pinhole of the photographs' own size; lens: of the photographs, None = a pinhole.
        longest: longer side of the pictures that are made, pixels.
    """
    scale = min(1.0, longest / max(camera.width, camera.height))
    small = camera if scale == 1 else camera.resized(round(camera.width * scale), round(camera.height * scale))
    if lens is None or lens.is_zero:
        return Straightened(small, None, None)
    own, new = camera.opencv_matrix, small.opencv_matrix
    size = (small.width, small.height)
    make = cv2.fisheye.initUndistortRectifyMap if lens.model == FISHEYE else cv2.initUndistortRectifyMap
    bent = np.asarray(lens.coefficients, dtype=np.float64)
    maps = np.stack(make(own, bent, np.eye(3), new, size, cv2.CV_32FC1), axis=-1)
    inside = (maps >= 0).all(axis=-1) & (maps[..., 0] <= camera.width - 1) & (maps[..., 1] <= camera.height - 1)
    return Straightened(small, np.asarray(maps, np.float32), None if inside.all() else ~inside)
