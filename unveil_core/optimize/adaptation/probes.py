"""Held-out parts of some views: they separate what generalizes from what only fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

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
    hidden = hidden_blocks(view.camera.height, view.camera.width)
    shown = torch.from_numpy((~hidden).astype(np.float32))
    return replace(view, weight=shown if view.weight is None else shown * view.weight)


def probe_error(state: Optimization, views: Sequence[TrainingView]) -> float:
    """Mean squared error of the hidden blocks of the probed views."""
    total = pixels = 0.0
    surfels, sky = state.result()
    for view in views:
        with torch.no_grad():
            out = render(surfels, view.camera, ("rgb", "alpha"), near=state.settings.near, far=state.settings.far)
            assert out.rgb is not None and out.alpha is not None
            image = (out.rgb + (1 - out.alpha)[..., None] * sky.sample(view.sky_grid)).clamp(0, 1)
        hidden = hidden_blocks(view.camera.height, view.camera.width)
        if view.weight is not None:  # what does not count tells nothing here either
            hidden &= view.weight.numpy() > 0.5
        error = np.square(image.numpy()[hidden] - view.image.numpy()[hidden], dtype=np.float64)
        total, pixels = total + float(error.sum()), pixels + error.size
    return total / max(pixels, 1)
