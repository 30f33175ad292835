"""What the optimization compares its renders with: photographs, labels and sky directions as tensors, at any resolution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.losses import camera_rays
from unveil_core.surfels.sky import Sky

__all__ = ["TrainingView", "training_view"]


@dataclass(frozen=True, eq=False)
class TrainingView:
    """One target of the optimization.

    Attributes:
        camera: at the resolution of the tensors.
        photograph: (H, W, 3) uint8; many views are held, and few are used at a time (see :attr:`image`).
        label_image: (H, W) int16 compact labels, negative = ignore; None = no semantics.
        weight: (H, W) float32, how much a pixel's colour counts; None = all fully.
        sky_grid: (1, H, W, 2) where the sky panorama is sampled.
        depth: (H, W) depth that is expected here, metres along the optical axis, 0 where there is no expectation; None =
            nowhere.
    """

    camera: Camera
    photograph: Tensor
    label_image: Tensor | None
    weight: Tensor | None
    sky_grid: Tensor
    depth: Tensor | None = None

    @property
    def image(self) -> Tensor:
        """(H, W, 3) float32 in [0, 1]."""
        return self.photograph.float() / 255

    @property
    def labels(self) -> Tensor | None:
        """(H, W) int64 compact labels, negative = ignore; None = no semantics."""
        return None if self.label_image is None else self.label_image.long()

    @property
    def rays(self) -> Tensor:
        """(H, W, 3) camera-frame rays with unit z."""
        return _rays(self.camera.intrinsics)


@lru_cache(maxsize=12)
def _rays(intrinsics: tuple[int, int, float, float, float, float]) -> Tensor:
    """The rays of all frames of a camera: a rig of six has so many at its two sizes."""
    return camera_rays(Camera(*intrinsics, np.eye(4)))


def training_view(
    camera: Camera,
    image: NDArray[np.uint8],
    labels: NDArray[np.int64] | None,
    weight: NDArray[np.float32] | None,
    sky: Sky,
    *,
    factor: float = 1.0,
) -> TrainingView:
    """Build a view, optionally smaller: the image by area, labels by nearest."""
    if factor != 1.0:
        size = (max(16, round(camera.width * factor)), max(16, round(camera.height * factor)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        if labels is not None:
            labels = cv2.resize(labels.astype(np.int16), size, interpolation=cv2.INTER_NEAREST)
        if weight is not None:
            weight = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
        camera = camera.resized(*size)
    return TrainingView(
        camera=camera,
        photograph=torch.from_numpy(np.ascontiguousarray(image)),
        label_image=None if labels is None else torch.from_numpy(labels.astype(np.int16)),
        weight=None if weight is None else torch.from_numpy(weight.astype(np.float32)),
        sky_grid=sky.grid(camera),
    )
