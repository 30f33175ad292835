"""The optimization loop, shared by reconstruction and re-optimization.

Two stages as in *3D StreetUnveiler*: first colour and labels with density control, then the geometric terms
(L_d, L_n, L_ds) with opacity pruning.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from unveil_core.optimize.density import DensityControl, DensitySettings
from unveil_core.optimize.losses import LossWeights, l1_dssim, normal_consistency, semantic_cross_entropy
from unveil_core.optimize.parameters import LearningRates, TrainableSurfels
from unveil_core.optimize.views import TrainingView
from unveil_core.progress import Progress, no_progress
from unveil_core.raster import Rendered, render
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["TrainSettings", "train"]


@dataclass(frozen=True)
class TrainSettings:
    """One run of the loop.

    Attributes:
        iterations: steps in all.
        geometry_from: the step at which the second stage begins (L_d, L_n, L_ds).
        weights: of the losses.
        density: density control, None = the set of surfels is fixed.
        prune_opacity: in the second stage surfels fainter than this go (paper: 0.3), except ``spared_labels``.
        prune_every: steps between such prunings.
        sky_rate: Adam step of the sky panorama, 0 = fixed.
        final_rate_share: the means' step size decays exponentially to this share.
        near, far: world units; the range that distortion is measured in.
    """

    iterations: int = 1000
    geometry_from: int = 700
    weights: LossWeights = field(default_factory=LossWeights)
    density: DensitySettings | None = field(default_factory=DensitySettings)
    prune_opacity: float = 0.3
    prune_every: int = 150
    sky_rate: float = 2e-3
    final_rate_share: float = 0.05
    near: float = 0.2
    far: float = 100.0


def train(
    surfels: Surfels,
    sky: Sky,
    views_at: Callable[[int], Sequence[TrainingView]],
    settings: TrainSettings,
    rates: LearningRates,
    *,
    label_count: int,
    sky_label: int | None,
    spared_labels: Sequence[int] = (),
    trainable_mask: Tensor | None = None,
    seed: int = 0,
    progress: Progress = no_progress,
) -> tuple[Surfels, Sky]:
    """Fit surfels and sky to views.

    Args:
        surfels: the start, N surfels.
        sky: the sky; its texture is trained unless ``sky_rate`` is 0.
        views_at: gives the targets for an iteration (resolution may rise with it); the same number each time.
        settings, rates: see there.
        label_count: K.
        sky_label: compact label of the sky or None.
        spared_labels: labels that opacity pruning leaves alone.
        trainable_mask: (N,) bool, surfels that may change; None = all. Excludes density control and pruning.
        seed: order of the views and of splits.
    Returns:
        the fitted surfels, detached, and sky.
    """
    w = settings.weights
    if trainable_mask is not None:
        settings = replace(settings, density=None)
    trainable = TrainableSurfels(surfels, rates)
    texture = sky.texture.clone().requires_grad_(settings.sky_rate > 0)
    sky_optimizer = torch.optim.Adam([texture], lr=settings.sky_rate) if settings.sky_rate > 0 else None
    density = DensityControl(settings.density, len(trainable), seed) if settings.density else None
    generator = np.random.default_rng(seed)
    order: list[int] = []
    spared = torch.tensor(list(spared_labels), dtype=torch.int64)
    running_loss = 0.0
    for iteration in range(settings.iterations):
        views = views_at(iteration)
        if not order:
            order = generator.permutation(len(views)).tolist()
        view = views[order.pop()]
        second_stage = iteration >= settings.geometry_from
        decay = settings.final_rate_share ** (iteration / max(1, settings.iterations))

        current = trainable.surfels
        planes = ["rgb", "alpha"]
        if w.semantic > 0 and view.labels is not None:
            planes.append("semantics")
        if second_stage:
            planes += ["depth", "normal"] if w.normal > 0 else []
            planes += ["distortion"] if w.distortion > 0 else []
            planes += ["label_distortion"] if w.label_distortion > 0 else []
        out = render(current, view.camera, planes, label_count=label_count, near=settings.near, far=settings.far)
        assert out.rgb is not None and out.alpha is not None
        background = sky.sample(view.sky_grid, texture)
        image = out.rgb + (1 - out.alpha)[..., None] * background
        loss = l1_dssim(image, view.image, view.weight, dssim=w.dssim)
        if out.semantics is not None and view.labels is not None:
            loss = loss + w.semantic * semantic_cross_entropy(
                out.semantics, out.alpha, view.labels, sky_label=sky_label, weight=view.weight
            )
        if out.distortion is not None:
            loss = loss + w.distortion * out.distortion.mean()
        if out.label_distortion is not None:
            loss = loss + w.label_distortion * out.label_distortion.mean()
        if out.normal is not None and out.depth is not None:
            loss = loss + w.normal * normal_consistency(out.normal, out.depth, out.alpha, view.rays, view.weight)
        if second_stage and w.opacity > 0:
            loss = loss + w.opacity * torch.sigmoid(current.opacity_logits).mean()
        loss.backward()  # type: ignore[no-untyped-call]
        value = loss.item()
        running_loss = value if iteration == 0 else 0.95 * running_loss + 0.05 * value
        if density is not None:
            _observe(density, out, current, view)
        trainable.step(trainable_mask, means_rate=rates.means * decay)
        if sky_optimizer is not None:
            sky_optimizer.step()
            sky_optimizer.zero_grad(set_to_none=True)
        if density is not None and density.due(iteration):
            density.act(trainable)
        turn = iteration - settings.geometry_from
        if trainable_mask is None and second_stage and turn > 0 and turn % settings.prune_every == 0:
            opacity = torch.sigmoid(trainable.leaves["opacity_logits"].detach())
            keep = (opacity >= settings.prune_opacity) | torch.isin(trainable.labels, spared)
            if not bool(keep.all()):
                trainable.keep(keep)
                if density is not None:
                    density.clear(len(trainable))
        progress(iteration + 1, settings.iterations, loss=running_loss, surfels=float(len(trainable)))
    return trainable.surfels.detach(), Sky(texture.detach(), sky.axes)


def _observe(density: DensityControl, out: Rendered, surfels: Surfels, view: TrainingView) -> None:
    with torch.no_grad():
        camera = view.camera
        row = torch.from_numpy(camera.world_to_camera[2].astype(np.float32))
        # Element by element: a matrix product may round differently with the memory's alignment, and splits hang on it.
        depth = ((surfels.means.detach() * row[:3]).sum(dim=1) + row[3]).clamp_min(1e-3)
        width = surfels.log_scales.detach().amax(dim=1).exp() * camera.fx / depth
        density.observe(out.screen_gradients(), out.visible, max(camera.width, camera.height) / 2, width)
