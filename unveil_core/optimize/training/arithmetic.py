"""Which code does the arithmetic of a step: kernels of the processor, fused by hand, or torch's own operations on any device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

from unveil_core.base.errors import Interrupted
from unveil_core.base.progress import stop_asked
from unveil_core.optimize.training import losses, torch_losses
from unveil_core.optimize.training.adam import adam_step
from unveil_core.optimize.training.torch_adam import adam_step as torch_adam_step

__all__ = ["KERNELS", "Arithmetic", "arithmetic_for", "torch_in_one_thread"]

KERNELS = ("auto", "fused", "torch")


@dataclass(frozen=True)
class Arithmetic:
    """The losses and Adam, in one of two ways that agree to 1e-5.

    Attributes:
        over_sky, l1_dssim, semantic_cross_entropy, normal_consistency: see ``losses``; adam_step: see ``adam``.
        at_once: whether a loss is a number as soon as it is made; if not, to look at it means to wait for the device.
    """

    over_sky: Callable[..., Tensor]
    l1_dssim: Callable[..., Tensor]
    semantic_cross_entropy: Callable[..., Tensor]
    normal_consistency: Callable[..., Tensor]
    adam_step: Callable[..., None]
    at_once: bool


FUSED = Arithmetic(
    losses.over_sky,
    losses.l1_dssim,
    losses.semantic_cross_entropy,
    losses.normal_consistency,
    adam_step,
    at_once=True,
)
TORCH = Arithmetic(
    torch_losses.over_sky,
    torch_losses.l1_dssim,
    torch_losses.semantic_cross_entropy,
    torch_losses.normal_consistency,
    torch_adam_step,
    at_once=False,
)


def arithmetic_for(kernels: str, device: torch.device) -> Arithmetic:
    """The arithmetic that is asked for.

    Args:
        kernels: "auto" takes the fused kernels on the processor and torch elsewhere; "fused" or "torch" by name, "torch" on the
            processor too, for comparison.
    Raises:
        ValueError: an unknown name, or the fused kernels on another device than the processor.
    """
    if kernels not in KERNELS:
        raise ValueError(f"not kernels: {kernels!r}; use {', '.join(KERNELS)}")
    if kernels == "fused" and device.type != "cpu":
        raise ValueError(f"the fused kernels work on the processor, not on {device}")
    return FUSED if kernels == "fused" or (kernels == "auto" and device.type == "cpu") else TORCH


_training = threading.RLock()
LOOKS_S = 0.1
"""Between looks whether a run that waits for another one's training is to end."""


@contextmanager
def torch_in_one_thread() -> Iterator[None]:
    """Keep torch from threads of its own: what it does between the kernels of a step takes less time than they take to wake, and
    they would do it on processors that the kernels need.

    How many there are is a matter of the process, half of it, and of the calling thread. So of several runs in one process one
    trains at a time; the processors are the same for all of them.

    Raises:
        Interrupted: the run was to end while another one trained.
    """
    while not _training.acquire(timeout=LOOKS_S):
        if stop_asked():
            raise Interrupted
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        _training.release()
