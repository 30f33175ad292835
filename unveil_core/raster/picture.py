"""A scene as a photograph would show it: surfels, and the sky where they leave light through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.pictures.levels import as_bytes
from unveil_core.base.types import Float32
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import Rendered
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered, there
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["levels_seen", "picture_of", "render_numpy", "with_sky"]


def with_sky(rgb: NDArray[np.float32], alpha: NDArray[np.float32], sky: Sky, camera: Camera) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB of rendered colour (H, W, 3) and alpha (H, W) over the sky."""
    return as_bytes(_over_sky(rgb, alpha, sky, camera))


def picture_of(surfels: Surfels, sky: Sky, camera: Camera, *, near: float, far: float) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB of a scene in its canonical colours; near, far: metres, as ``render`` takes them."""
    return as_bytes(levels_seen(surfels, sky, camera, near=near, far=far))


def levels_seen(surfels: Surfels, sky: Sky, camera: Camera, *, near: float, far: float) -> Float32:
    """The same as levels of 255 that are neither rounded nor cut off."""
    out = rendered(near_camera(surfels, camera), camera, ("rgb", "alpha"), near=near, far=far)
    if out.visible.device.type == "cpu":
        return _over_sky(array(out.rgb), array(out.alpha), sky, camera)
    return _over_sky_there(out, sky, camera)


def _over_sky(rgb: Float32, alpha: Float32, sky: Sky, camera: Camera) -> Float32:
    picture: Float32 = np.float32(255) * (rgb + (1 - alpha)[..., None] * sky.render(camera).numpy())
    return picture


def _over_sky_there(out: Rendered, sky: Sky, camera: Camera) -> Float32:
    """The same on the device of the planes: one picture is all that comes back."""
    assert out.rgb is not None and out.alpha is not None
    behind = sky.to(out.rgb.device).sample(sky.grid_there(camera, out.rgb.device))
    return array((out.rgb + (1 - out.alpha)[..., None] * behind) * 255)


def render_numpy(
    surfels: Surfels, camera: Camera, *, near: float, far: float, apart: Sequence[int] = ()
) -> dict[str, NDArray[np.float32]]:
    """rgb (H, W, 3), alpha (H, W), depth (H, W; expected, 0 where nothing) of a scene, as arrays.

    Args:
        apart: labels; where there are any, ``kinds`` (H, W, 2) tells the weight of all others, and of these.
    """
    planes = ["rgb", "alpha", "depth"]
    surfels = there(near_camera(surfels, camera))
    if apart:
        planes.append("semantics")
        labels = torch.tensor(apart, device=surfels.device)
        surfels = replace(surfels, labels=torch.isin(surfels.labels, labels).long())
    out = rendered(surfels, camera, planes, label_count=2 if apart else None, near=near, far=far)
    alpha = array(out.alpha).copy()
    depth = np.where(alpha > 1e-3, array(out.depth) / np.maximum(alpha, 1e-3), 0)
    found = {"rgb": array(out.rgb).copy(), "alpha": alpha, "depth": depth.astype(np.float32)}
    if out.semantics is not None:
        found["kinds"] = array(out.semantics).copy()
    return found
