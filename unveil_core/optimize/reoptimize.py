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

from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.kernels.device import current_device
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.base.types import Levels
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.arithmetic import torch_in_one_thread
from unveil_core.optimize.training.card_memory import StepSize, largest_step, place_for
from unveil_core.optimize.training.losses import LossWeights
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import TrainingView, training_view, views_on
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["REOPTIMIZE_PRESETS", "ReoptimizeSettings", "reoptimize"]

MANY_FRAMES = 100
"""Frames up to which a drive has the same number of steps."""


@dataclass(frozen=True)
class ReoptimizeSettings:
    """Attributes:
    iterations: steps, of drives of up to ``MANY_FRAMES`` frames; of longer ones they are more in proportion.
    near_m: surfels nearer than this to a removed one may change, metres.
    ground_spacing_m: distance between new surfels on invented ground, metres.
    weights: L1 with D-SSIM, L_d and L_n, as the paper; labels are given, not fitted.
    """

    iterations: int = 100
    near_m: float = 0.5
    ground_spacing_m: float = 0.08
    weights: LossWeights = field(default_factory=lambda: LossWeights(semantic=0.0, label_distortion=0.0, opacity=0.0))

    def scaled(self, frames: int) -> ReoptimizeSettings:
        """These settings for a number of frames; each frame has its turn at least once."""
        if not self.iterations:
            return self
        factor = max(1.0, frames / MANY_FRAMES)
        return replace(self, iterations=max(frames, round(self.iterations * factor)))


REOPTIMIZE_PRESETS: dict[str, ReoptimizeSettings] = {
    "draft": ReoptimizeSettings(iterations=80, ground_spacing_m=0.12),
    "standard": ReoptimizeSettings(),
    "high": ReoptimizeSettings(iterations=1000, ground_spacing_m=0.05),
}


@torch_in_one_thread()
def reoptimize(
    surfels: Surfels,
    movable: NDArray[np.bool_],
    sky: Sky,
    targets: Sequence[tuple[Camera, Levels]],
    settings: ReoptimizeSettings,
    *,
    near: float,
    far: float,
    label_count: int,
    depths: Sequence[NDArray[np.float64]] | None = None,
    seed: int = 0,
    cache: FrameCache | None = None,
    checkpoint: Checkpoint | None = None,
    progress: Progress = no_progress,
) -> Surfels:
    """Fit the movable surfels of the empty scene to inpainted frames, on the device of the run (``base.kernels.device``).

    Args:
        surfels: the empty scene with its new surfels, N of them.
        movable: (N,) bool.
        sky: fixed.
        targets: (camera, cleaned frame (H, W, 3) levels of 255).
        near, far: metres.
        depths: (H, W) per target, the depth that is expected, 0 = none; it counts by ``weights.depth``.
        cache: room for the targets; checkpoint: from which an interrupted call is continued.
    Returns:
        the scene, in the same order.
    """
    if not movable.any() or settings.iterations == 0:
        return surfels

    def view(i: int) -> TrainingView:
        made = training_view(*targets[i], None, None, sky)
        return made if depths is None else replace(made, depth=torch.from_numpy(depths[i].astype(np.float32)))

    def largest() -> tuple[StepSize, ...]:
        return (largest_step(len(surfels), surfels.sh_degree, (camera for camera, _ in targets), label_count),)

    place = place_for(current_device(), largest)
    device, room = place.device, place.fine_bytes + place.coarse_bytes
    if place.why:
        progress(0, settings.iterations, place.why)
    views = views_on((cache or FrameCache()).frames(len(targets), view), sky, torch.device(device.name), room)
    training = TrainSettings(weights=settings.weights, sky_rate=0.0, near=near, far=far, backend=device.backend)
    # Of the sizes that were tried, those with which 100 steps reach what 250 do with steps half as large.
    rates = LearningRates(
        means=0.002, quats=4e-3, log_scales=1e-2, opacity_logits=8e-2, sh_base=2e-2, sh_rest=5e-4, final=1.0
    )
    state = Optimization(
        surfels.to(device.name),
        sky,
        training,
        rates,
        label_count=label_count,
        sky_label=None,
        moving=torch.from_numpy(movable.copy()),
        seed=seed,
    )
    begun = 0
    checkpoint = checkpoint or Checkpoint()
    if (found := checkpoint.load()) is not None:
        state.restore(found[0], found[1]["state"])
        begun = int(found[1]["begun"])
    for turn in range(begun, settings.iterations):
        state.step(views, geometry=True, done=turn / settings.iterations)
        if checkpoint.due():
            arrays, facts = state.checkpoint()
            checkpoint.save(arrays, {"state": facts, "begun": turn + 1})
        progress(turn + 1, settings.iterations, loss=state.loss, surfels=float(len(state)))
    return state.result()[0].to("cpu")
