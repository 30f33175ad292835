"""Adaptive density control: clone surfels that are too small, split those that are too large, remove those without effect.

*3D Gaussian Splatting*, section 5.2, with hard labels inherited on clone and split (*3D StreetUnveiler*, section 3.1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from unveil_core.optimize.training.parameters import TrainableSurfels
from unveil_core.surfels.surfels import Surfels, concatenate, rotations

__all__ = ["DensityControl", "DensitySettings", "cut_in_two"]

CHILD_OFFSET, CHILD_SCALE, CHILD_WIDTH = 0.5, 0.6, 0.75
"""Of a split surfel's standard deviations: where its children lie along the longest axis, theirs along it, and across."""


@dataclass(frozen=True)
class DensitySettings:
    """How the number of surfels follows the error.

    Attributes:
        gradient_threshold: mean gradient of the loss by the screen position (in half image sizes) that calls for more.
        split_scale_px: a surfel wider than this on the screen is split, else cloned.
        min_opacity: fainter surfels are removed.
        budget: no growth beyond this many surfels.
    """

    gradient_threshold: float = 2e-4
    split_scale_px: float = 4.0
    min_opacity: float = 0.02
    budget: int = 150_000


class DensityControl:
    """Accumulates screen-space gradients between its turns, on the device of the surfels."""

    def __init__(self, settings: DensitySettings, count: int, device: torch.device | str = "cpu") -> None:
        self.settings, self.device = settings, device
        self.clear(count)

    def clear(self, count: int) -> None:
        """Forget what was observed; ``count`` surfels from now on."""
        self.gradient = torch.zeros(count, device=self.device)
        self.seen = torch.zeros(count, device=self.device)
        self.width_px = torch.zeros(count, device=self.device)

    def tensors(self) -> dict[str, Tensor]:
        """What was observed, (N,) each, by name."""
        return {"gradient": self.gradient, "seen": self.seen, "width_px": self.width_px}

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Go on from what :meth:`tensors` gave."""
        self.gradient, self.seen, self.width_px = (tensors[name].to(self.device) for name in self.tensors())

    def observe(self, screen_gradients: Tensor, visible: Tensor, half_size_px: float, width_px: Tensor) -> None:
        """Note one step.

        Args:
            screen_gradients: (N, 2) gradient by the projected mean in pixels; visible: (N,) bool.
            half_size_px: half of the longer image side, which makes gradients independent of resolution.
            width_px: (N,) standard deviation on the screen.
        """
        norm = screen_gradients.norm(dim=1) * half_size_px
        self.gradient += torch.where(visible, norm, 0.0)
        self.seen += visible
        self.width_px = torch.maximum(self.width_px, torch.where(visible, width_px, 0.0))

    def act(self, trainable: TrainableSurfels) -> tuple[int, int]:
        """Change the set of surfels; returns how many were added and dropped."""
        s = self.settings
        surfels = trainable.surfels.detach()
        mean_gradient = self.gradient / self.seen.clamp_min(1)
        wanted = mean_gradient > s.gradient_threshold
        room = max(0, s.budget - len(surfels))
        if int(wanted.sum()) > room:
            # The most wanting first; ties by index keep it reproducible.
            order = torch.argsort(mean_gradient, descending=True, stable=True)[:room]
            limited = torch.zeros_like(wanted)
            limited[order] = True
            wanted &= limited
        split = wanted & (self.width_px > s.split_scale_px)
        clone = wanted & ~split
        opacity = torch.sigmoid(surfels.opacity_logits)
        drop = opacity < s.min_opacity
        surfels = _halved(surfels, clone)
        trainable.set_opacity(surfels.opacity_logits)
        added = [surfels.select(clone & ~drop), *cut_in_two(surfels.select(split & ~drop))]
        keep = ~(drop | split)
        new = concatenate(added)
        trainable.rebuild(keep, new if len(new) else None)
        self.clear(len(trainable))
        return len(new), int((~keep).sum())


def _halved(surfels: Surfels, cloned: Tensor) -> Surfels:
    """The surfels with the opacity in those that are cloned, (N,) bool, that lets two of them cover what one did: with
    1 - sqrt(1 - o) each nothing changes until they move apart (Bulò et al., *Revising densification in Gaussian splatting*, 2024,
    section 3.3)."""
    through = torch.nn.functional.logsigmoid(-surfels.opacity_logits)  # log(1 - o)
    half = -torch.expm1(0.5 * through)
    logits = torch.log(half) - 0.5 * through
    return replace(surfels, opacity_logits=torch.where(cloned, logits, surfels.opacity_logits))


def cut_in_two(parents: Surfels) -> list[Surfels]:
    """Two smaller children per parent, side by side along its longest axis, with its opacity, colour and label.

    3DGS draws the children's places from the parent: as many fall together as leave a gap, and held-out views lose 1 to 2 dB for
    a hundred steps. Side by side they lose half of that, end as good, and no random number is needed.
    """
    rows = torch.arange(len(parents), device=parents.device)
    longest = parents.log_scales.argmax(dim=1)
    axis = rotations(parents.quats)[rows, :, longest]
    step = axis * (CHILD_OFFSET * parents.log_scales[rows, longest].exp())[:, None]
    log_scales = parents.log_scales + math.log(CHILD_WIDTH)
    log_scales[rows, longest] += math.log(CHILD_SCALE / CHILD_WIDTH)
    return [replace(parents, means=parents.means + side * step, log_scales=log_scales) for side in (1, -1)]
