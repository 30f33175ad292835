"""Carrying what was invented from one view to the others: as surfels on the completed depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.raster import render
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

__all__ = ["complete_depth", "render_numpy", "seed_pixels"]


def complete_depth(
    depth: NDArray[np.float32], known: NDArray[np.bool_], wanted: NDArray[np.bool_], ceiling: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Continue inverse depth into ``wanted`` pixels.

    Inverse depth is linear over a plane in the image, so a smooth continuation of it continues planes.

    Args:
        depth: (H, W); known: (H, W) where it can be trusted; wanted: (H, W) where it is asked for.
        ceiling: (H, W) depth of the ground, which nothing can lie behind; inf where there is none.
    """
    usable = known & ~wanted
    inverse = np.where(usable, 1.0 / np.maximum(depth, 1e-6), 0).astype(np.float32)
    if not usable.any():
        return np.where(np.isfinite(ceiling), ceiling, 50.0)
    scale = float(inverse[usable].max())
    filled = cv2.inpaint(inverse / scale, (~usable).astype(np.uint8), 5, cv2.INPAINT_NS) * scale
    floor = float(inverse[usable].min())
    completed = 1.0 / np.maximum(filled.astype(np.float64), floor)
    return np.minimum(np.where(wanted, completed, depth), ceiling)


def seed_pixels(
    camera: Camera,
    color: NDArray[np.uint8],
    depth: NDArray[np.float64],
    label: NDArray[np.int64],
    mask: NDArray[np.bool_],
    *,
    sh_degree: int,
) -> Surfels:
    """One surfel per pixel of ``mask``, facing the camera, as large as the pixel there.

    Args:
        color: (H, W, 3) uint8; depth: (H, W) along the optical axis; label: (H, W) compact.
    """
    rows, columns = np.nonzero(mask)
    z = depth[rows, columns]
    rays = camera.rays()[rows, columns]
    positions = camera.centre + z[:, None] * rays
    normal = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return surfels_from_points(
        positions, color[rows, columns], label[rows, columns], normal, z / camera.fx,
        sh_degree=sh_degree, opacity=0.95, scale_factor=0.7,
    )  # fmt: skip


def render_numpy(
    surfels: Surfels, camera: Camera, *, near: float, far: float, apart: Sequence[int] = ()
) -> dict[str, NDArray[np.float32]]:
    """rgb (H, W, 3), alpha (H, W), depth (H, W; expected, 0 where nothing) of a scene, as arrays.

    Args:
        apart: labels; where there are any, ``kinds`` (H, W, 2) tells the weight of all others, and of these.
    """
    planes = ["rgb", "alpha", "depth"]
    if apart:
        planes.append("semantics")
        surfels = replace(surfels, labels=torch.isin(surfels.labels, torch.tensor(apart)).long())
    with torch.no_grad():
        out = render(surfels, camera, planes, label_count=2 if apart else None, near=near, far=far)
    assert out.rgb is not None and out.alpha is not None and out.depth is not None
    alpha = out.alpha.numpy().copy()
    depth = np.where(alpha > 1e-3, out.depth.numpy() / np.maximum(alpha, 1e-3), 0)
    found = {"rgb": out.rgb.numpy().copy(), "alpha": alpha, "depth": depth.astype(np.float32)}
    if out.semantics is not None:
        found["kinds"] = out.semantics.numpy().copy()
    return found
