"""Labels as trainable probabilities, for comparison only: *3D StreetUnveiler* argues for hard ones (section 3.1, table 3).

The rasterizer knows hard labels. Probabilities are rendered as colours, three at a time, which costs a pass each.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster import render
from unveil_core.raster.spherical_harmonics import SH0
from unveil_core.surfels.surfels import Surfels

__all__ = ["label_logits", "render_soft_labels"]

SURE = 0.9
"""Probability of its own label that a surfel starts with."""


def label_logits(labels: Tensor, count: int) -> Tensor:
    """(N, K) logits of probabilities that are sure of ``labels`` (N,) int64, of ``count`` labels K."""
    other = (1 - SURE) / max(1, count - 1)
    odds = torch.full((len(labels), count), other, device=labels.device).scatter_(1, labels[:, None], SURE)
    return odds.log()


def render_soft_labels(
    surfels: Surfels, logits: Tensor, camera: Camera, *, near: float, far: float, backend: str = "auto"
) -> Tensor:
    """(H, W, K) accumulated probabilities, differentiable in the surfels and in ``logits`` (N, K)."""
    probabilities = torch.softmax(logits, dim=1)
    count = probabilities.shape[1]
    padded = torch.nn.functional.pad(probabilities, (0, -count % 3))
    planes = []
    for first in range(0, count, 3):
        colored = replace(surfels, sh=((padded[:, None, first : first + 3] - 0.5) / SH0).contiguous())
        plane = render(colored, camera, ("rgb",), near=near, far=far, backend=backend).rgb
        assert plane is not None
        planes.append(plane)
    return torch.cat(planes, dim=2)[..., :count].contiguous()
