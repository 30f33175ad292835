"""The one autograd function between torch and a backend."""

from __future__ import annotations

import importlib
import os
from contextlib import nullcontext
from typing import Any

import torch
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.passes import Inputs, Settings, group_for
from unveil_core.raster.spec import Limits
from unveil_core.surfels.surfels import Surfels

__all__ = ["Screen", "can_render_on", "rasterize"]


def can_render_on(device: torch.device) -> bool:
    """Whether the triton backend takes tensors of this device: a GPU's, or any in Triton's interpreter."""
    return device.type == "cuda" or os.environ.get("TRITON_INTERPRET") == "1"


class Screen:
    """What a pass tells beside its planes.

    Attributes:
        visible: (N,) bool, on the screen.
        gradients: (N, 2) gradient by the projected means in pixels, None before backward.
    """

    visible: Tensor
    gradients: Tensor | None = None


class _Lease:
    """Holds a pass's memory as long as the graph lives, and returns it when the graph is gone or backward has run."""

    def __init__(self, backend: Any, done: Any) -> None:
        self.backend, self.done = backend, done

    def __del__(self) -> None:
        self.backend.release(self.done)


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quats: Tensor,
        log_scales: Tensor,
        opacity_logits: Tensor,
        sh: Tensor,
        labels: Tensor,
        camera: Camera,
        names: tuple[str, ...],
        settings: Settings,
        screen: Screen,
        backend: Any,
    ) -> tuple[Tensor, ...]:
        inputs = (means, quats, log_scales, opacity_logits, sh)
        done = backend.forward_pass(inputs, labels, camera, settings, keep=True)
        screen.visible = done.visible
        # Saved by torch, so that a parameter changed in place before backward is noticed.
        ctx.save_for_backward(*inputs)
        ctx.set_materialize_grads(False)
        ctx.lease, ctx.screen, ctx.names = _Lease(backend, done), screen, names
        return tuple(done.planes.pop(name) for name in names)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor | None) -> tuple[Tensor | None, ...]:
        if ctx.lease is None:
            raise RuntimeError("backward through one render twice; render again instead")
        grads = {name: grad for name, grad in zip(ctx.names, grad_outputs, strict=True) if grad is not None}
        *gradients, ctx.screen.gradients = ctx.lease.backend.backward_pass(ctx.lease.done, grads, ctx.saved_tensors)
        ctx.lease = None
        return (*gradients, None, None, None, None, None, None)


def rasterize(
    surfels: Surfels,
    camera: Camera,
    names: tuple[str, ...],
    *,
    label_count: int,
    coefficients: int,
    near: float,
    far: float,
    backend: str,
    limits: Limits,
) -> tuple[dict[str, Tensor], Screen]:
    """The named planes, with a gradient where torch records one, and what the pass tells beside them.

    Args:
        backend: "cpu" or "triton", a folder with a module ``backend`` beside this one.
    """
    module = importlib.import_module(f"unveil_core.raster.{backend}.backend")
    settings = Settings(group_for(names), label_count, coefficients, near, far, limits, names)
    inputs = (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh)
    screen = Screen()
    # Kernels start on the current GPU, which need not be the surfels'. Backward runs in a thread of the right one.
    on_its_gpu = torch.cuda.device(surfels.means.device) if surfels.means.is_cuda else nullcontext()
    with on_its_gpu:
        return _rasterized(module, inputs, surfels.labels, camera, names, settings, screen), screen


def _rasterized(
    module: Any,
    inputs: Inputs,
    labels: Tensor,
    camera: Camera,
    names: tuple[str, ...],
    settings: Settings,
    screen: Screen,
) -> dict[str, Tensor]:
    if not (torch.is_grad_enabled() and any(t.requires_grad for t in inputs)):
        done = module.forward_pass(inputs, labels, camera, settings, keep=False)
        screen.visible = done.visible
        return {name: done.planes[name] for name in names}
    planes = _Rasterize.apply(*inputs, labels, camera, names, settings, screen, module)  # type: ignore[no-untyped-call]
    return dict(zip(names, planes, strict=True))
