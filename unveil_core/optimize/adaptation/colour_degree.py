"""The degree of spherical harmonics that a scene needs, chosen by held-out error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.optimize.adaptation.choices import Looks, decibels, step_cost
from unveil_core.optimize.adaptation.probes import probe_error
from unveil_core.optimize.training.schedule import Phase
from unveil_core.optimize.training.trainer import Optimization
from unveil_core.raster.spherical_harmonics import basis
from unveil_core.surfels.surfels import Surfels

__all__ = ["choose_sh_degree", "lowered", "seen_from_anywhere"]

DIRECTIONS = 12
"""Cameras, evenly spread, whose directions a lower degree is fitted to."""
PRIOR = 1e-3
"""Pull towards the coefficients as they are, in cameras: where none sees a surfel, nothing changes."""


def lowered(surfels: Surfels, degree: int, cameras: Sequence[Camera]) -> Surfels:
    """The surfels with a lower degree of colour that comes nearest to the present one in the views that see them.

    Cutting the higher coefficients off would shift the colours: seen from one side, they are part of the mean.
    """
    width = (degree + 1) ** 2
    with torch.no_grad():
        low = surfels.sh[:, :width].double()
        normal = PRIOR * torch.eye(width, dtype=torch.float64).expand(len(surfels), -1, -1).clone()
        wanted = PRIOR * low
        for camera in cameras:
            directions, weight = _seen_from(surfels.means.double(), camera)
            full = basis(directions, surfels.sh_degree)
            own = full[:, :width] * weight[:, None]
            normal += own[:, :, None] * full[:, None, :width]
            wanted += own[:, :, None] * (full[:, None] @ surfels.sh.double())
        fitted = torch.linalg.solve(normal, wanted)
    return replace(surfels, sh=fitted.float())


def seen_from_anywhere(surfels: Surfels, cameras: Sequence[Camera], degree: int | None) -> Surfels:
    """The surfels as the empty scene has them: of one colour from all directions, unless the user gave a ``degree``.

    In the directions from which a removed object hid a wall its colour was never observed, and the harmonics that fit the others
    would show a ghost of the object there.
    """
    if degree or not surfels.sh_degree:
        return surfels
    return lowered(surfels, 0, cameras[:: max(1, len(cameras) // DIRECTIONS)])


def _seen_from(means: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """Unit directions (N, 3) from a camera, and 1 (N,) where the image shows the place, else 0."""
    away = means - torch.from_numpy(camera.centre)
    pixel, depth = (torch.from_numpy(a) for a in camera.project(means.numpy()))
    inside = (depth > 0) & (pixel >= 0).all(dim=1) & (pixel[:, 0] < camera.width) & (pixel[:, 1] < camera.height)
    return away / away.norm(dim=1, keepdim=True).clamp_min(1e-12), inside.double()


def choose_sh_degree(
    state: Optimization, phase: Phase, steps: int, looks: Looks
) -> tuple[Optimization, dict[str, Any]]:
    """Lower the degree of colour as far as the held-out error hardly tells, each trial with some steps to settle.

    Downwards, for what a degree is worth shows only when it has had time to be learned.

    Returns:
        the state of the degree that was chosen, and the numbers that chose it.
    """
    highest = state.trainable.surfels.sh_degree
    cameras = [view.camera for view in phase.views[:: max(1, len(phase.views) // DIRECTIONS)]]
    trials, psnr = [], []
    for degree in range(highest + 1):
        trial = state.copy()
        if degree < highest:
            now = trial.trainable.surfels.detach()
            trial.trainable.set_sh(lowered(now.to("cpu"), degree, cameras).to(now.device))
        for turn in range(steps):
            # Smaller and smaller steps, as in the end: large ones shake more than a degree of colour tells.
            trial.step(phase.views, geometry=False, done=phase.last + (1 - phase.last) * turn / steps)
            looks.work += step_cost(phase.views[0], len(trial))
        trials.append(trial)
        psnr.append(decibels(probe_error(trial, looks.probes[phase.name])))
    # The lowest that no higher one betters by so much a degree.
    chosen = next(
        low
        for low in range(highest + 1)
        if all(psnr[high] - psnr[low] < looks.settings.sh_gain * (high - low) for high in range(low + 1, highest + 1))
    )
    by_degree = {str(degree): round(value, 3) for degree, value in enumerate(psnr)}
    return trials[chosen], {"chosen": chosen, "highest": highest, "steps": steps, "psnr_of_degree": by_degree}
