"""Depth views of a surfel scene, for fusing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.drives.drive import Frame
from unveil_core.mesh.tsdf import DepthView
from unveil_core.raster import render
from unveil_core.surfels.surfels import Surfels

__all__ = ["depth_views"]

SOLID = 0.7


def depth_views(
    surfels: Surfels,
    frames: Iterable[Frame],
    *,
    near: float,
    far: float,
    without: Sequence[NDArray[np.bool_]] | None = None,
) -> Iterator[DepthView]:
    """Median depth and colour of the frames' cameras, where the surfels are solid, one after the other.

    Args:
        without: per frame (H, W), pixels that are left out.
    """
    for i, frame in enumerate(frames):
        with torch.no_grad():
            out = render(surfels, frame.camera, ("rgb", "alpha", "median_depth"), near=near, far=far)
        assert out.rgb is not None and out.alpha is not None and out.median_depth is not None
        alpha = out.alpha.numpy()
        solid = alpha > SOLID
        if without is not None:
            solid &= ~without[i]
        rgb = np.clip(out.rgb.numpy() / np.maximum(alpha, 1e-3)[..., None], 0, 1)
        yield DepthView(frame.camera, np.where(solid, out.median_depth.numpy(), 0).astype(np.float32), rgb)
