"""Carrying what was invented from one view to the others: as surfels on the completed depth."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.street_chart import INVENTED, StreetChart
from unveil_core.raster import render
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

__all__ = ["complete_depth", "render_numpy", "seed_ground", "seed_pixels", "texels_in_pixels"]


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


def seed_ground(
    chart: StreetChart, region: NDArray[np.bool_], *, spacing: float, up: NDArray[np.float64], sh_degree: int,
    default_label: int,
) -> Surfels:  # fmt: skip
    """Surfels for invented ground.

    Args:
        region: (A, B) texels to consider; of them those that are invented get surfels.
        spacing: distance between surfels, world units; up: (3,).
    """
    step = max(1, round(spacing / chart.texel))
    wanted = np.zeros_like(region)
    wanted[step // 2 :: step, step // 2 :: step] = True
    rows, columns = np.nonzero(wanted & region & (chart.source == INVENTED))
    colors = cv2.GaussianBlur(chart.color, (0, 0), max(0.3, 0.4 * step))[rows, columns]
    label = chart.label[rows, columns].astype(np.int64)
    normal = np.repeat(up[None] / np.linalg.norm(up), len(rows), axis=0)
    return surfels_from_points(
        chart.world(rows, columns), np.clip(np.round(colors * 255), 0, 255).astype(np.uint8),
        np.where(label >= 0, label, default_label), normal, np.full(len(rows), step * chart.texel),
        sh_degree=sh_degree, opacity=0.95, scale_factor=0.7,
    )  # fmt: skip


def texels_in_pixels(
    chart: StreetChart, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
) -> NDArray[np.bool_]:
    """(A, B) invented texels that fall into the pixels of some view's mask.

    Args:
        masks: (H, W) one a camera.
    """
    rows, columns = np.nonzero(chart.source == INVENTED)
    fall = np.zeros(len(rows), dtype=bool)
    places = chart.world(rows, columns)
    for camera, mask in zip(cameras, masks, strict=True):
        if not len(rows) or not mask.any():
            continue
        pixel, depth = camera.project(places)
        inside = camera.in_picture(pixel, depth, nearest=0.0)
        column, row = pixel[inside].astype(np.int64).T
        fall[inside] |= mask[row, column]
    found = np.zeros(chart.source.shape, dtype=bool)
    found[rows[fall], columns[fall]] = True
    return found


def render_numpy(surfels: Surfels, camera: Camera, *, near: float, far: float) -> dict[str, NDArray[np.float32]]:
    """rgb (H, W, 3), alpha (H, W), depth (H, W; expected, 0 where nothing) of a scene, as arrays."""
    with torch.no_grad():
        out = render(surfels, camera, ("rgb", "alpha", "depth"), near=near, far=far)
    assert out.rgb is not None and out.alpha is not None and out.depth is not None
    alpha = out.alpha.numpy().copy()
    depth = np.where(alpha > 1e-3, out.depth.numpy() / np.maximum(alpha, 1e-3), 0)
    return {"rgb": out.rgb.numpy().copy(), "alpha": alpha, "depth": depth.astype(np.float32)}
