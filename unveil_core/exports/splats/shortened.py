"""Needles shortened: splats metres long that fit what the drive's cameras see, and stick out of the street beside their views.

The optimization sees a splat from the street alone, most of it in line with the view, and nothing holds its far end. Frames and
renders are none the worse for that, and are left as they are. A program that shows splats from anywhere gets them shortened.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from unveil_core.base.types import Float64
from unveil_core.surfels.surfels import Surfels

__all__ = ["LONGEST_M", "SHARE_OF_DISTANCE", "TIMES_WIDTH", "shortened"]

LONGEST_M = 1.0
"""Standard deviation that a splat may have wherever it lies, metres; as ``blender_addon/formats/gaussians.py`` has it.
Tried from 0.3 to 1 m on three streets: at 1 m hardly a needle is left to see, and pictures from the drive's own cameras
differ least from those of the scene as it was: by 0.2 to 1.3 levels on the mean, against 1.4 to 3.2 at 0.3 m."""
SHARE_OF_DISTANCE = 0.05
"""Of the distance to the nearest camera, that it may have besides: what is far is coarse. Tried from 0.02 to 0.05, as above."""
TIMES_WIDTH = 2.0
"""Times its second extent, that it may have besides: what is broad is no needle. Tried at 1 and 2; at 1 a street of coarse facades
loses 3 dB of its own pictures."""
CHUNK = 4096
"""Splats whose distances to all cameras are in memory at a time."""


def shortened(surfels: Surfels, centres: Float64) -> Surfels:
    """The splats (N) with extents that a street has.

    Args:
        surfels: in local coordinates, metres.
        centres: (C, 3) where the drive's cameras are, in the same coordinates.
    """
    extents = surfels.log_scales.double().exp().sort(dim=1, descending=True).values
    longest = torch.clamp(TIMES_WIDTH * extents[:, 1], min=LONGEST_M)
    long = (extents[:, 0] > longest).nonzero()[:, 0]
    if not len(long) or not len(centres):
        return surfels
    means = surfels.means[long].double().numpy()
    away = np.concatenate(
        [
            np.linalg.norm(means[i : i + CHUNK, None] - centres[None], axis=2).min(axis=1)
            for i in range(0, len(long), CHUNK)
        ]
    )
    most = torch.maximum(longest[long], SHARE_OF_DISTANCE * torch.from_numpy(away)).log().to(surfels.log_scales.dtype)
    log_scales = surfels.log_scales.clone()
    log_scales[long] = torch.minimum(log_scales[long], most[:, None])
    return replace(surfels, log_scales=log_scales)
