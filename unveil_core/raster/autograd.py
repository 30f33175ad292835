"""The one autograd function between torch and a backend."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.cpu import backend
from unveil_core.surfels.surfels import Surfels

__all__ = ["Screen", "rasterize"]


class Screen:
    """What a pass tells beside its planes.

    Attributes:
        visible: (N,) bool, on the screen.
        gradients: (N, 2) gradient by the projected means in pixels, None before backward.
    """

    visible: Tensor
    gradients: Tensor | None = None


class _Lease:
    """Holds a pass's buffers as long as the graph lives, and returns them when it is gone or backward has run."""

    def __init__(self, done: backend.Pass) -> None:
        self.done = done

    def __del__(self) -> None:
        backend.release(self.done)


def _inputs(means: Tensor, quats: Tensor, log_scales: Tensor, opacity_logits: Tensor, sh: Tensor) -> backend.Inputs:
    return _array(means), _array(quats), _array(log_scales), _array(opacity_logits), _array(sh)


def _array(tensor: Tensor) -> NDArray[Any]:
    array: NDArray[Any] = tensor.detach().contiguous().numpy()
    return array


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, means: Tensor, quats: Tensor, log_scales: Tensor, opacity_logits: Tensor, sh: Tensor, labels: Tensor,
        camera: Camera, names: tuple[str, ...], settings: backend.Settings, screen: Screen,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        inputs = (means, quats, log_scales, opacity_logits, sh)
        done = backend.forward_pass(_inputs(*inputs), _array(labels), camera, settings, keep=True)
        screen.visible = torch.from_numpy(done.visible)
        # Saved by torch, so that a parameter changed in place before backward is noticed.
        ctx.save_for_backward(*inputs)
        ctx.set_materialize_grads(False)
        ctx.lease, ctx.screen, ctx.names = _Lease(done), screen, names
        return tuple(torch.from_numpy(done.planes[name]) for name in names)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor | None) -> tuple[Tensor | None, ...]:
        if ctx.lease is None:
            raise RuntimeError("backward through one render twice; render again instead")
        grads = {
            name: np.ascontiguousarray(grad.numpy())
            for name, grad in zip(ctx.names, grad_outputs, strict=True)
            if grad is not None
        }
        *gradients, on_screen = backend.backward_pass(ctx.lease.done, grads, _inputs(*ctx.saved_tensors))
        ctx.screen.gradients = torch.from_numpy(on_screen)
        ctx.lease = None
        return (*(torch.from_numpy(g) for g in gradients), None, None, None, None, None)


def rasterize(
    surfels: Surfels, camera: Camera, names: tuple[str, ...], *, label_count: int, coefficients: int, near: float,
    far: float,
) -> tuple[dict[str, Tensor], Screen]:  # fmt: skip
    """The named planes, with a gradient where torch records one, and what the pass tells beside them."""
    settings = backend.Settings(backend.group_for(names), label_count, coefficients, near, far)
    inputs = (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh)
    screen = Screen()
    if not (torch.is_grad_enabled() and any(t.requires_grad for t in inputs)):
        done = backend.forward_pass(_inputs(*inputs), _array(surfels.labels), camera, settings, keep=False)
        screen.visible = torch.from_numpy(done.visible)
        return {name: torch.from_numpy(done.planes[name]) for name in names}, screen
    planes = _Rasterize.apply(*inputs, surfels.labels, camera, names, settings, screen)  # type: ignore[no-untyped-call]
    return dict(zip(names, planes, strict=True)), screen
