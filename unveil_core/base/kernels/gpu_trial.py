"""A kernel built and run on a GPU: what shows whether one can be.

Triton builds code for the card and a launcher for this Python, with a C compiler and Python's headers. That either is missing, that
Triton is too old, or that a card is newer than the build of PyTorch shows only when that is done.
"""

# mypy: ignore-errors
from __future__ import annotations

import torch
import triton
import triton.language as tl

__all__ = ["run_trial"]

COUNT = 32


@triton.jit
def _count_up(values, SIZE: tl.constexpr):
    at = values + tl.arange(0, SIZE)
    tl.store(at, tl.load(at) + 1)


def run_trial(device: str) -> None:
    """Build and run it; raises whatever goes wrong there."""
    values = torch.zeros(COUNT, device=device)
    _count_up[(1,)](values, SIZE=COUNT, enable_fp_fusion=True)
    if float(values.sum()) != COUNT:
        raise RuntimeError("a kernel wrote something else than it was to")
