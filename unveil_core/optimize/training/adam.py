"""Adam (Kingma and Ba 2015) for some rows of a tensor, or all; and for one small tensor as a whole.

Surfels that the current view does not show take part: moving only the visible ones would save a little memory traffic, but
they then take fewer effective steps, and after the same number of iterations the sample street was 0.5 dB worse.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import in_parallel

__all__ = ["Adam", "adam_step"]

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-15
f32, u64 = np.float32, np.uint64


@njit(inline="always")
def _moved(g, m, v, bias1, bias2):
    """Both new moments, and the step over the rate as a fraction."""
    m = f32(BETA1) * m + f32(1 - BETA1) * g
    v = f32(BETA2) * v + f32(1 - BETA2) * g * g
    return m, v, m * bias1, np.sqrt(v * bias2) + f32(EPSILON)


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(start, stop, values, gradient, first, second, rate, rest_rate, moving, bias1, bias2):
    width = u64(values.shape[1])
    for n in range(start, stop):
        if not moving[n]:
            continue
        for d in range(width):
            m, v, above, below = _moved(gradient[n, d], first[n, d], second[n, d], bias1, bias2)
            first[n, d], second[n, d] = m, v
            values[n, d] -= (rate if d < u64(3) else rest_rate) * above / below


@njit(cache=True, nogil=True, error_model="numpy")
def _flat(start, stop, values, gradient, first, second, rate, bias1, bias2):
    for i in range(u64(start), u64(stop)):
        m, v, above, below = _moved(gradient[i], first[i], second[i], bias1, bias2)
        first[i], second[i] = m, v
        values[i] -= rate * above / below


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
    """One step in place.

    Args:
        values, gradient, first, second: (N, ...) float32, contiguous: parameters, gradient, both moments.
        moving: (N,) bool, the rows that change; None = all.
        turn: how many steps were taken, this one included.
        rate: step size; rest_rate: the step size of all numbers of a row but the first three, the same by default.
    """
    rows = len(values)
    if rows == 0 or values.numel() == 0:
        return
    arrays = [t.detach().view(rows, -1).numpy() for t in (values, gradient.contiguous(), first, second)]
    scales = f32(1 / (1 - BETA1**turn)), f32(1 / (1 - BETA2**turn))
    if moving is None and rest_rate is None:
        flat = [a.reshape(-1) for a in arrays]
        in_parallel(_flat, len(flat[0]), 16384, *flat, f32(rate), *scales)
        return
    rates = f32(rate), f32(rate if rest_rate is None else rest_rate)
    mask = np.ones(rows, np.uint8) if moving is None else moving.numpy().view(np.uint8)
    in_parallel(_rows, rows, 1024, *arrays, *rates, mask, *scales)


class Adam:
    """Adam of one tensor, step for step what ``torch.optim.Adam`` does, which brings torch's compiler along: seconds to import.

    Args:
        values: a leaf that collects gradients; rate: step size.
    """

    EPSILON = 1e-8

    def __init__(self, values: Tensor, rate: float) -> None:
        self.values, self.rate, self.turn = values, rate, 0
        self.first, self.second = torch.zeros_like(values), torch.zeros_like(values)

    def copy(self, values: Tensor) -> Adam:
        """A copy of the state for another tensor of the same shape."""
        twin = Adam(values, self.rate)
        twin.turn, twin.first, twin.second = self.turn, self.first.clone(), self.second.clone()
        return twin

    @torch.no_grad()
    def step(self) -> None:
        """One step in place where there is a gradient, which is cleared."""
        gradient = self.values.grad
        if gradient is None:
            return
        self.turn += 1
        self.first.lerp_(gradient, 1 - BETA1)
        self.second.mul_(BETA2).addcmul_(gradient, gradient, value=1 - BETA2)
        below = (self.second.sqrt() / (1 - BETA2**self.turn) ** 0.5).add_(self.EPSILON)
        self.values.addcdiv_(self.first, below, value=-self.rate / (1 - BETA1**self.turn))
        self.values.grad = None
