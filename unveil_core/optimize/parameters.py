"""Trainable surfels with their Adam moments, kept in step when surfels come and go."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from unveil_core.optimize.adam import adam_step
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["LearningRates", "TrainableSurfels"]


@dataclass(frozen=True)
class LearningRates:
    """Adam step sizes per attribute; ``means`` in world units, ``sh_base`` for the constant colour term."""

    means: float
    quats: float = 2e-3
    log_scales: float = 8e-3
    opacity_logits: float = 4e-2
    sh_base: float = 5e-3
    sh_rest: float = 2.5e-4


class TrainableSurfels:
    """The one mutable object of the optimization: leaf tensors, their moments, and the fixed labels.

    Attributes:
        leaves: by name, tensors that collect gradients.
        first, second: by name, Adam's moments in the leaves' shapes.
        labels: (N,) int64.
        turn: steps taken.
    """

    NAMES = ("means", "quats", "log_scales", "opacity_logits", "sh")

    def __init__(self, surfels: Surfels, rates: LearningRates) -> None:
        self.rates = rates
        self.turn = 0
        self._set(surfels)
        self.first = {name: torch.zeros_like(leaf.detach()) for name, leaf in self.leaves.items()}
        self.second = {name: torch.zeros_like(leaf.detach()) for name, leaf in self.leaves.items()}

    def _set(self, surfels: Surfels) -> None:
        self.leaves = {
            name: getattr(surfels, name).detach().clone().contiguous().requires_grad_(True) for name in self.NAMES
        }
        self.labels = surfels.labels

    def __len__(self) -> int:
        return int(self.labels.shape[0])

    @property
    def surfels(self) -> Surfels:
        """The current values, differentiable."""
        return Surfels(**self.leaves, labels=self.labels)

    def step(self, moving: Tensor | None = None, *, means_rate: float | None = None) -> None:
        """One Adam step of the surfels in ``moving`` (N,) bool, None = all; gradients are cleared.

        Args:
            means_rate: step size of the means instead of the one given at first.
        """
        self.turn += 1
        rates = {name: getattr(self.rates, "sh_base" if name == "sh" else name) for name in self.NAMES}
        if means_rate is not None:
            rates["means"] = means_rate
        for name, leaf in self.leaves.items():
            if leaf.grad is not None:
                adam_step(
                    leaf, leaf.grad, self.first[name], self.second[name], moving, turn=self.turn, rate=rates[name],
                    rest_rate=self.rates.sh_rest if name == "sh" else None,
                )  # fmt: skip
                leaf.grad = None

    def keep(self, mask: Tensor) -> None:
        """Drop the surfels where ``mask`` (N,) is False, moments with them."""
        self.rebuild(mask, None)

    def rebuild(self, mask: Tensor, added: Surfels | None) -> None:
        """Keep ``mask`` (N,) and append new surfels with zero moments."""
        kept = self.surfels.detach().select(mask)
        self._set(kept if added is None else concatenate([kept, added]))
        for moments in (self.first, self.second):
            for name, leaf in self.leaves.items():
                held = moments[name][mask]
                fresh = held.new_zeros((len(leaf) - len(held), *held.shape[1:]))
                moments[name] = torch.cat([held, fresh])
