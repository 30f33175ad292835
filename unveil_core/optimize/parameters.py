"""Trainable surfels with their Adam moments, kept in step when surfels come and go."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["LearningRates", "TrainableSurfels"]


@dataclass(frozen=True)
class LearningRates:
    """Adam step sizes per attribute; ``means`` in world units."""

    means: float
    quats: float = 2e-3
    log_scales: float = 8e-3
    opacity_logits: float = 4e-2
    sh_base: float = 5e-3
    sh_rest: float = 2.5e-4


class TrainableSurfels:
    """The one mutable object of the optimization: leaf tensors, their optimizer, and the fixed labels.

    ``sh`` is trained as two groups, the constant term and the rest, because they learn at different rates.
    """

    _GROUPS = ("means", "quats", "log_scales", "opacity_logits", "sh_base", "sh_rest")

    def __init__(self, surfels: Surfels, rates: LearningRates) -> None:
        self.rates = rates
        self._set(surfels, None)

    def _set(self, surfels: Surfels, moments: dict[str, tuple[Tensor, Tensor, Tensor]] | None) -> None:
        s = surfels.detach()
        values = {
            "means": s.means, "quats": s.quats, "log_scales": s.log_scales, "opacity_logits": s.opacity_logits,
            "sh_base": s.sh[:, :1], "sh_rest": s.sh[:, 1:],
        }  # fmt: skip
        self.leaves = {k: v.clone().contiguous().requires_grad_(True) for k, v in values.items()}
        self.labels = s.labels
        self.optimizer = torch.optim.Adam(
            [{"params": [self.leaves[k]], "lr": getattr(self.rates, k), "name": k} for k in self._GROUPS],
            eps=1e-15, fused=True,
        )  # fmt: skip
        if moments:
            for k, (step, first, second) in moments.items():
                self.optimizer.state[self.leaves[k]] = {"step": step, "exp_avg": first, "exp_avg_sq": second}

    def __len__(self) -> int:
        return int(self.labels.shape[0])

    @property
    def surfels(self) -> Surfels:
        """The current values, differentiable."""
        v = self.leaves
        sh = torch.cat([v["sh_base"], v["sh_rest"]], dim=1) if v["sh_rest"].shape[1] else v["sh_base"]
        return Surfels(v["means"], v["quats"], v["log_scales"], v["opacity_logits"], sh, self.labels)

    def set_rate(self, name: str, rate: float) -> None:
        """Change one attribute's step size."""
        for group in self.optimizer.param_groups:
            if group["name"] == name:
                group["lr"] = rate

    def step(self) -> None:
        """One Adam step; gradients are cleared."""
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)

    def keep(self, mask: Tensor) -> None:
        """Drop the surfels where ``mask`` (N,) is False, moments with them."""
        self.rebuild(mask, None)

    def rebuild(self, mask: Tensor, added: Surfels | None) -> None:
        """Keep ``mask`` (N,) and append new surfels with zero moments."""
        kept = self.surfels.detach().select(mask)
        fresh = kept if added is None else concatenate([kept, added])
        moments: dict[str, tuple[Tensor, Tensor, Tensor]] = {}
        for k in self._GROUPS:
            state = self.optimizer.state.get(self.leaves[k])
            if not state:
                continue
            first, second = state["exp_avg"][mask], state["exp_avg_sq"][mask]
            if added is not None:
                empty = first.new_zeros((len(added), *first.shape[1:]))
                first, second = torch.cat([first, empty]), torch.cat([second, empty])
            moments[k] = (state["step"], first.contiguous(), second.contiguous())
        self._set(fresh, moments)

    def reset_opacity(self, ceiling: float) -> None:
        """Bring opacities down to at most ``ceiling`` and forget their moments."""
        leaf = self.leaves["opacity_logits"]
        with torch.no_grad():
            leaf.clamp_(max=float(torch.logit(torch.tensor(ceiling))))
        state = self.optimizer.state.get(leaf)
        if state:
            state["exp_avg"].zero_()
            state["exp_avg_sq"].zero_()
