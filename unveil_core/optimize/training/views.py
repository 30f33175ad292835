"""What the optimization compares its renders with: photographs, labels and sky directions as tensors, at any resolution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.pictures.levels import as_bytes
from unveil_core.base.types import Levels
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.losses import camera_rays
from unveil_core.surfels.sky import Sky

__all__ = ["MOST_RAYS", "TrainingView", "training_view", "views_on"]

MOST_RAYS = 12
"""Cameras and sizes whose rays are kept: a rig of six has so many at its two sizes."""


@dataclass(frozen=True, eq=False)
class TrainingView:
    """One target of the optimization.

    Attributes:
        camera: at the resolution of the tensors.
        photograph: (H, W, 3) uint8, or half floats where colours lie beyond its range; many views are held, and few are used at a
            time (see :attr:`image`).
        label_image: (H, W) int16 compact labels, negative = ignore; None = no semantics.
        weight: (H, W) float32, how much a pixel's colour counts; None = all fully.
        sky_grid: (1, H, W, 2) where the sky panorama is sampled; None = computed from ``sky_turn`` when it is asked for.
        depth: (H, W) depth that is expected here, metres along the optical axis, 0 where there is no expectation; None =
            nowhere.
        sky_turn: (3, 3) of ``Sky.turn``; forward_row: (4,) float32, third row of ``world_to_camera``: both only of a view on
            another device than the processor, where bringing them at each step would cost a transfer.
    """

    camera: Camera
    photograph: Tensor
    label_image: Tensor | None
    weight: Tensor | None
    sky_grid: Tensor | None
    depth: Tensor | None = None
    sky_turn: Tensor | None = None
    forward_row: Tensor | None = None

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
        return _rays(self.camera.intrinsics, self.photograph.device)

    @property
    def forward(self) -> Tensor:
        """(4,) float32: with a place in homogeneous coordinates its depth, metres."""
        if self.forward_row is not None:
            return self.forward_row
        return torch.from_numpy(self.camera.world_to_camera[2].astype(np.float32))

    def sky_positions(self, sky: Sky) -> Tensor:
        """(1, H, W, 2) where the panorama is sampled."""
        if self.sky_grid is not None:
            return self.sky_grid
        assert self.sky_turn is not None
        return sky.grid_of_rays(self.rays, self.sky_turn)

    def to(self, device: torch.device, sky: Sky) -> TrainingView:
        """The same on another device than the processor."""

        def there(tensor: Tensor | None) -> Tensor | None:
            return None if tensor is None else tensor.to(device)

        return replace(
            self,
            photograph=self.photograph.to(device),
            label_image=there(self.label_image),
            weight=there(self.weight),
            depth=there(self.depth),
            sky_grid=None,
            sky_turn=sky.turn(self.camera).to(device),
            forward_row=self.forward.to(device),
        )


def views_on(views: Sequence[TrainingView], sky: Sky, device: torch.device, most_bytes: int) -> Sequence[TrainingView]:
    """The views on a device, held there as long as there is room; on the processor the views themselves.

    Args:
        most_bytes: room on the device: a view of 1920x1280 takes 12 MB, so that most drives stay there whole.
    """
    if device.type == "cpu":
        return views
    return FrameCache(most_bytes).frames(len(views), lambda i: views[i].to(device, sky))


@lru_cache(maxsize=MOST_RAYS)
def _rays(intrinsics: tuple[int, int, float, float, float, float], device: torch.device) -> Tensor:
    """The rays of all frames of a camera."""
    return camera_rays(Camera(*intrinsics, np.eye(4))).to(device)


def training_view(
    camera: Camera,
    image: Levels,
    labels: NDArray[np.int64] | None,
    weight: NDArray[np.float32] | None,
    sky: Sky,
    *,
    factor: float = 1.0,
) -> TrainingView:
    """Build a view, optionally smaller: the image by area, labels by nearest.

    Its levels are rounded: the optimization takes the mean of many pixels, and many views are held.
    """
    if factor != 1.0:
        size = (max(16, round(camera.width * factor)), max(16, round(camera.height * factor)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if labels is not None:
            labels = cv2.resize(labels.astype(np.int16), size, interpolation=cv2.INTER_NEAREST)
        if weight is not None:
            weight = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
        camera = camera.resized(*size)
    within = image.dtype == np.uint8 or (image.min() > -0.5 and image.max() < 255.5)
    return TrainingView(
        camera=camera,
        photograph=torch.from_numpy(np.ascontiguousarray(as_bytes(image) if within else image.astype(np.float16))),
        label_image=None if labels is None else torch.from_numpy(labels.astype(np.int16)),
        weight=None if weight is None else torch.from_numpy(weight.astype(np.float32)),
        sky_grid=sky.grid(camera),
    )
