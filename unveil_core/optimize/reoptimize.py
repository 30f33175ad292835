"""Re-optimization near removed objects: the empty scene is fitted to the inpainted frames.

*3D StreetUnveiler*, section 3.4: only surfels near the removed ones move, and the new ones seeded in the holes; the target is
the inpainted frame inside the removed region and the photograph outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.losses import LossWeights
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import training_view
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["REOPTIMIZE_PRESETS", "ReoptimizeSettings", "reoptimize"]


@dataclass(frozen=True)
class ReoptimizeSettings:
    """Attributes:
    iterations: steps.
    near_m: surfels nearer than this to a removed one may change, metres.
    ground_spacing_m: distance between new surfels on invented ground, metres.
    weights: L1 with D-SSIM, L_d and L_n, as the paper; labels are given, not fitted.
    """

    iterations: int = 250
    near_m: float = 0.5
    ground_spacing_m: float = 0.08
    weights: LossWeights = field(default_factory=lambda: LossWeights(semantic=0.0, label_distortion=0.0, opacity=0.0))


REOPTIMIZE_PRESETS: dict[str, ReoptimizeSettings] = {
    "draft": ReoptimizeSettings(iterations=80, ground_spacing_m=0.12),
    "standard": ReoptimizeSettings(),
    "high": ReoptimizeSettings(iterations=1000, ground_spacing_m=0.05),
}


def reoptimize(
    surfels: Surfels,
    movable: NDArray[np.bool_],
    sky: Sky,
    targets: Sequence[tuple[Camera, NDArray[np.uint8]]],
    settings: ReoptimizeSettings,
    *,
    near: float,
    far: float,
    label_count: int,
    depths: Sequence[NDArray[np.float64]] | None = None,
    seed: int = 0,
    progress: Progress = no_progress,
) -> Surfels:
    """Fit the movable surfels of the empty scene to inpainted frames.

    Args:
        surfels: the empty scene with its new surfels, N of them.
        movable: (N,) bool.
        sky: fixed.
        targets: (camera, cleaned frame (H, W, 3) uint8).
        near, far: metres.
        depths: (H, W) per target, the depth that is expected, 0 = none; it counts by ``weights.depth``.
    Returns:
        the scene, in the same order.
    """
    if not movable.any() or settings.iterations == 0:
        return surfels
    views = [training_view(camera, image, None, None, sky) for camera, image in targets]
    if depths is not None:
        views = [replace(v, depth=torch.from_numpy(d.astype(np.float32))) for v, d in zip(views, depths, strict=True)]
    training = TrainSettings(weights=settings.weights, sky_rate=0.0, near=near, far=far)
    rates = LearningRates(
        means=0.001, quats=2e-3, log_scales=5e-3, opacity_logits=4e-2, sh_base=1e-2, sh_rest=2.5e-4, final=1.0
    )
    state = Optimization(
        surfels,
        sky,
        training,
        rates,
        label_count=label_count,
        sky_label=None,
        moving=torch.from_numpy(movable.copy()),
        seed=seed,
    )
    for turn in range(settings.iterations):
        state.step(views, geometry=True, done=turn / settings.iterations)
        progress(turn + 1, settings.iterations, loss=state.loss, surfels=float(len(state)))
    return state.result()[0]
