"""Held-out parts of some views: they separate what generalizes from what only fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.optimize.training.trainer import Optimization
from unveil_core.optimize.training.views import TrainingView
from unveil_core.raster import render

__all__ = ["HIDDEN_SHARE", "hidden_blocks", "probe_error", "probed_frames"]

PROBED_FRAMES = 6
BLOCKS_ACROSS = 12
HIDDEN_SHARE = 0.25
"""Of a probed view; its other pixels are trained on."""


def probed_frames(count: int) -> list[int]:
    """Which of so many frames are probed: a sixth of them, six at most, evenly spread and not at the ends."""
    wanted = min(PROBED_FRAMES, max(1, count // 6))
    return sorted({int((k + 0.5) * count / wanted) for k in range(wanted)})


def hidden_blocks(height: int, width: int) -> NDArray[np.bool_]:
    """(H, W), a quarter of the pixels in square blocks, none beside another: they are determined by other views only."""
    side = max(4, -(-width // BLOCKS_ACROSS))
    rows, columns = np.arange(height) // side % 2, np.arange(width) // side % 2
    return (rows[:, None] == 1) & (columns[None] == 1)


def hide(view: TrainingView) -> TrainingView:
    """The view without its hidden blocks."""
    shown = _shown(view.camera.height, view.camera.width, view.photograph.device)
    return replace(view, weight=shown if view.weight is None else shown * view.weight)


@lru_cache(maxsize=12)
def _shown(height: int, width: int, device: torch.device) -> Tensor:
    """(H, W) float32 weights, 0 in the hidden blocks: of the cameras of a rig at their two sizes."""
    return torch.from_numpy((~hidden_blocks(height, width)).astype(np.float32)).to(device)


def probe_error(state: Optimization, views: Sequence[TrainingView]) -> float:
    """Mean squared error of the hidden blocks of the probed views."""
    total = pixels = 0.0
    surfels, sky = state.result()
    for view in views:
        with torch.no_grad():
            s = state.settings
            out = render(surfels, view.camera, ("rgb", "alpha"), near=s.near, far=s.far, backend=s.backend)
            assert out.rgb is not None and out.alpha is not None
            image = (out.rgb + (1 - out.alpha)[..., None] * sky.sample(view.sky_positions(sky))).clamp(0, 1)
        hidden = hidden_blocks(view.camera.height, view.camera.width)
        if view.weight is not None:  # what does not count tells nothing here either
            hidden &= view.weight.cpu().numpy() > 0.5
        shown, seen = image.cpu().numpy(), view.image.cpu().numpy()
        error = np.square(shown[hidden] - seen[hidden], dtype=np.float64)
        total, pixels = total + float(error.sum()), pixels + error.size
    return total / max(pixels, 1)
