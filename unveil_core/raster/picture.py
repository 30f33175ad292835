"""A scene as a photograph would show it: surfels, and the sky where they leave light through."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.raster import render
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["picture_of", "with_sky"]


def with_sky(rgb: NDArray[np.float32], alpha: NDArray[np.float32], sky: Sky, camera: Camera) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB of rendered colour (H, W, 3) and alpha (H, W) over the sky."""
    picture = rgb + (1 - alpha)[..., None] * sky.render(camera).numpy()
    return np.clip(np.round(picture * 255), 0, 255).astype(np.uint8)


def picture_of(surfels: Surfels, sky: Sky, camera: Camera, *, near: float, far: float) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB of a scene in its canonical colours; near, far: world units, as ``render`` takes them."""
    with torch.no_grad():
        out = render(surfels, camera, ("rgb", "alpha"), near=near, far=far)
    assert out.rgb is not None and out.alpha is not None
    return with_sky(out.rgb.numpy(), out.alpha.numpy(), sky, camera)
