"""Trainable surfels with their Adam moments, kept in step when surfels are added and removed."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.optimize.training.arithmetic import Arithmetic, arithmetic_for
from unveil_core.optimize.training.soft_labels import label_logits
from unveil_core.surfels.surfels import Surfels, concatenate, with_sh_degree

__all__ = ["LearningRates", "TrainableSurfels"]


@dataclass(frozen=True)
class LearningRates:
    """Adam step sizes per attribute at the start; ``means`` in metres, ``sh_base`` for the constant colour term.

    They fall exponentially: the means' to ``final_means`` of the start, the others' to ``final``. A few hundred steps with
    large steps first end 0.6 to 1.4 dB above as many of one size (held-out views of the truth scenes); the higher
    coefficients take as large steps as the constant one: they see fewer views, and there is no time to wait for them. Rotations
    take small steps: measured points know their normals, and larger ones buy 0.2 dB with a tenth of the F-score at 5 cm.
    """

    means: float
    quats: float = 5e-4
    log_scales: float = 3.2e-2
    opacity_logits: float = 8e-2
    sh_base: float = 1e-2
    sh_rest: float = 5e-3
    label_logits: float = 5e-2
    final: float = 0.25
    final_means: float = 0.05

    def at(self, name: str, done: float) -> float:
        """The step size of an attribute at a fraction of the schedule, 0 to 1."""
        start: float = getattr(self, name)
        return start * float((self.final_means if name == "means" else self.final) ** done)


class TrainableSurfels:
    """The one mutable object of the optimization: leaf tensors, their moments, and the fixed labels, on the device of the surfels.

    Attributes:
        leaves: by name, tensors that collect gradients; with soft labels also ``label_logits`` (N, K).
        first, second: by name, Adam's moments in the leaves' shapes.
        labels: (N,) int64.
        turn: steps taken.
    """

    NAMES = ("means", "quats", "log_scales", "opacity_logits", "sh")

    def __init__(
        self, surfels: Surfels, rates: LearningRates, *, soft_labels: int = 0, arithmetic: Arithmetic | None = None
    ) -> None:
        self.rates, self.soft_labels = rates, soft_labels
        self.arithmetic = arithmetic or arithmetic_for("auto", surfels.device)
        self.turn = 0
        self._set(surfels)
        self.first = {name: torch.zeros_like(leaf.detach()) for name, leaf in self.leaves.items()}
        self.second = {name: torch.zeros_like(leaf.detach()) for name, leaf in self.leaves.items()}

    def _set(self, surfels: Surfels, logits: Tensor | None = None) -> None:
        self.leaves = {
            name: getattr(surfels, name).detach().clone().contiguous().requires_grad_(True) for name in self.NAMES
        }
        self.labels = surfels.labels
        if logits is None and self.soft_labels:
            logits = label_logits(surfels.labels, self.soft_labels)
        if logits is not None:
            self.leaves["label_logits"] = logits.detach().clone().requires_grad_(True)

    def __len__(self) -> int:
        return int(self.labels.shape[0])

    @property
    def surfels(self) -> Surfels:
        """The current values, differentiable."""
        return Surfels(**{name: self.leaves[name] for name in self.NAMES}, labels=self.labels)

    def step(self, moving: Tensor | None = None, *, done: float = 0.0) -> None:
        """One Adam step of the surfels in ``moving`` (N,) bool, None = all; gradients are cleared.

        Args:
            done: how much of the schedule is over, 0 to 1.
        """
        self.turn += 1
        for name, leaf in self.leaves.items():
            if leaf.grad is not None:
                rate = self.rates.at("sh_base" if name == "sh" else name, done)
                self.arithmetic.adam_step(
                    leaf,
                    leaf.grad,
                    self.first[name],
                    self.second[name],
                    moving,
                    turn=self.turn,
                    rate=rate,
                    rest_rate=self.rates.at("sh_rest", done) if name == "sh" else None,
                )
                leaf.grad = None

    def copy(self) -> TrainableSurfels:
        """A copy of the state."""
        twin = copy(self)
        twin._set(self.surfels, self.leaves.get("label_logits"))
        twin.first = {name: moment.clone() for name, moment in self.first.items()}
        twin.second = {name: moment.clone() for name, moment in self.second.items()}
        return twin

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """The state but for the rates."""
        parts = {"leaf": self.leaves, "first": self.first, "second": self.second}
        found = {f"{part}.{name}": t.detach().cpu().numpy() for part, of in parts.items() for name, t in of.items()}
        return {**found, "labels": self.labels.cpu().numpy(), "turn": np.array(self.turn)}

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Go on from what :meth:`arrays` gave."""
        device = self.labels.device
        leaf, first, second = (
            {
                name.removeprefix(part): torch.from_numpy(a).to(device)
                for name, a in arrays.items()
                if name.startswith(part)
            }
            for part in ("leaf.", "first.", "second.")
        )
        self.leaves = {name: t.requires_grad_(True) for name, t in leaf.items()}
        self.first, self.second = first, second
        self.labels, self.turn = torch.from_numpy(arrays["labels"]).to(device), int(arrays["turn"])

    def set_opacity(self, logits: Tensor) -> None:
        """Go on with other opacities, (N,) logits; the moments stay."""
        self.leaves["opacity_logits"] = logits.detach().clone().contiguous().requires_grad_(True)

    def set_sh_degree(self, degree: int) -> None:
        """Let the colours have coefficients up to a degree; new ones start at zero, higher ones are dropped."""
        self.set_sh(with_sh_degree(self.surfels.detach(), degree))

    def set_sh(self, recoloured: Surfels) -> None:
        """Go on with the same surfels in other colours, of any degree."""
        self._set(recoloured, self.leaves.get("label_logits"))
        for moments in (self.first, self.second):
            held = moments["sh"][:, : self.leaves["sh"].shape[1]]
            fresh = held.new_zeros(len(held), self.leaves["sh"].shape[1] - held.shape[1], 3)
            moments["sh"] = torch.cat([held, fresh], dim=1)

    def keep(self, mask: Tensor) -> None:
        """Drop the surfels where ``mask`` (N,) is False, moments with them."""
        self.rebuild(mask, None)

    def rebuild(self, mask: Tensor, added: Surfels | None) -> None:
        """Keep ``mask`` (N,) and append new surfels with zero moments."""
        kept = self.surfels.detach().select(mask)
        logits = None
        if self.soft_labels:
            logits = self.leaves["label_logits"].detach()[mask]
            # New surfels are sure of their label again.
            if added is not None:
                logits = torch.cat([logits, label_logits(added.labels, self.soft_labels)])
        self._set(kept if added is None else concatenate([kept, added]), logits)
        for moments in (self.first, self.second):
            for name, leaf in self.leaves.items():
                held = moments[name][mask]
                fresh = held.new_zeros((len(leaf) - len(held), *held.shape[1:]))
                moments[name] = torch.cat([held, fresh])
