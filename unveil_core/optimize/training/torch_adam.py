"""The step of ``adam.adam_step`` as torch code, for any device: nothing in it waits for the device."""

from __future__ import annotations

import torch
from torch import Tensor

from unveil_core.optimize.training.adam import BETA1, BETA2, EPSILON

__all__ = ["adam_step"]


@torch.no_grad()
def adam_step(
    values: Tensor,
    gradient: Tensor,
    first: Tensor,
    second: Tensor,
    moving: Tensor | None,
    *,
    turn: int,
    rate: float,
    rest_rate: float | None = None,
) -> None:
    """One step in place; arguments as of ``adam.adam_step``, tensors of one device."""
    rows = len(values)
    if rows == 0 or values.numel() == 0:
        return
    x, g, m, v = (t.detach().view(rows, -1) for t in (values, gradient.contiguous(), first, second))
    if moving is None:
        m.mul_(BETA1).add_(g, alpha=1 - BETA1)
        v.mul_(BETA2).addcmul_(g, g, value=1 - BETA2)
    else:
        # By ``where``, not by index: how many rows move would be asked of the device.
        row = moving[:, None]
        m.copy_(torch.where(row, BETA1 * m + (1 - BETA1) * g, m))
        v.copy_(torch.where(row, BETA2 * v + (1 - BETA2) * g * g, v))
    below = (v / (1 - BETA2**turn)).sqrt_().add_(EPSILON)
    above = m / (1 - BETA1**turn)
    if moving is not None:
        above *= row
    if rest_rate is None:
        x.addcdiv_(above, below, value=-rate)
    else:
        x[:, :3].addcdiv_(above[:, :3], below[:, :3], value=-rate)
        x[:, 3:].addcdiv_(above[:, 3:], below[:, 3:], value=-rest_rate)
