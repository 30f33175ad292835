"""The one autograd function between torch and a backend."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.cpu import backend

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


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, means: Tensor, quats: Tensor, scales: Tensor, opacity: Tensor, rgb: Tensor, labels: Tensor,
        camera: Camera, label_count: int, geometry: bool, with_labels: bool, near: float, far: float, screen: Screen,
    ) -> Tensor:  # fmt: skip
        arrays = [np.ascontiguousarray(t.detach().numpy()) for t in (means, quats, scales, opacity, rgb, labels)]
        done = backend.forward_pass(
            *arrays, camera, label_count=label_count, geometry=geometry, with_labels=with_labels, near=near, far=far
        )
        screen.visible = torch.from_numpy(done.visible.astype(bool))
        planes = torch.from_numpy(done.planes.copy())
        ctx.lease, ctx.screen = _Lease(done), screen
        return planes

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        if ctx.lease is None:
            raise RuntimeError("backward through one render twice; render again instead")
        grad = np.ascontiguousarray(grad_outputs[0].numpy())
        *gradients, on_screen = backend.backward_pass(ctx.lease.done, grad)
        ctx.screen.gradients = torch.from_numpy(on_screen)
        ctx.lease = None
        return (*(torch.from_numpy(g) for g in gradients), *([None] * 8))


def rasterize(
    means: Tensor, quats: Tensor, scales: Tensor, opacity: Tensor, rgb: Tensor, labels: Tensor, camera: Camera, *,
    label_count: int, geometry: bool, with_labels: bool, near: float, far: float,
) -> tuple[Tensor, Screen]:  # fmt: skip
    """Planes (11 + K, H, W) with a gradient, and what the pass tells beside them."""
    screen = Screen()
    planes: Tensor = _Rasterize.apply(  # type: ignore[no-untyped-call]
        means, quats, scales, opacity, rgb, labels, camera, label_count, geometry, with_labels, near, far, screen
    )
    return planes, screen
