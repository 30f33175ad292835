"""The losses of ``losses.py`` as torch code, for any device: the same values and gradients to 1e-5, and nothing that waits for
the device.

Counts and sums stay tensors, and where a pixel does not count is a product or ``where``, never an index: both would ask the device
how many there are. The structural term has its gradient in closed form, because torch would keep a dozen images for it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

from unveil_core.optimize.training.loss_kernels import REACH, window

__all__ = ["l1_dssim", "normal_consistency", "semantic_cross_entropy"]

C1, C2 = 0.01**2, 0.03**2
"""Constants of SSIM for colours in [0, 1] (Wang et al. 2004, section III-B)."""
FLOOR = 1e-3
"""Least alpha that is divided by, and least probability whose logarithm is taken; as in ``loss_kernels``."""


def _at_least(values: Tensor, bound: float) -> Tensor:
    """``values.clamp_min(bound)``, with the gradient at the bound itself that the fused kernels have: it passes.

    Up to 2.14 torch's own passes there, from 2.15 on it does not, and a probability of exactly zero is nothing rare.
    """
    return torch.where(values < bound, bound, values)


@lru_cache(maxsize=8)
def _taps(device: torch.device) -> Tensor:
    """(11,) taps of the window: brought to a device once."""
    return torch.from_numpy(window()).to(device)


def _blurred(images: Tensor) -> Tensor:
    """(C, H, W) images blurred by the window, with a zero border, which makes the blur its own adjoint.

    One convolution along each axis, each image a group of its own: torch then uses its direct kernel in full float32, where a
    plain convolution would be rounded to TF32 on NVIDIA cards.
    """
    count = len(images)
    taps = _taps(images.device)
    across = taps.view(1, 1, 1, -1).expand(count, 1, 1, -1)
    down = taps.view(1, 1, -1, 1).expand(count, 1, -1, 1)
    once = F.conv2d(images[None], across, padding=(0, REACH), groups=count)
    return F.conv2d(once, down, padding=(REACH, 0), groups=count)[0]


class _WithGradient(torch.autograd.Function):
    """A scalar whose gradient by its input is known already."""

    @staticmethod
    def forward(ctx: Any, value: Tensor, gradient: Tensor, image: Tensor) -> Tensor:
        ctx.save_for_backward(gradient)
        return value

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        return None, None, gradient * grad_outputs[0]


def _dissimilarity(x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Sum of 1 - SSIM of two images (3, H, W), and SSIM's derivatives by the blurred x, x*x and x*y (9, H, W).

    Wang et al. 2004, equation 13.
    """
    mx, my, xx, yy, xy = _blurred(torch.cat([x, y, x * x, y * y, x * y])).view(5, *x.shape)
    squares = mx * mx + my * my + C1
    spread = xx - mx * mx + (yy - my * my) + C2
    luminance = 2 * mx * my + C1
    structure = 2 * (xy - mx * my) + C2
    below = squares * spread
    ssim = luminance * structure / below
    by_square = -ssim / spread
    by_product = 2 * luminance / below
    by_mean = 2 * (my * structure / below - mx * ssim / squares) - 2 * mx * by_square - my * by_product
    return (1 - ssim).sum(), torch.cat([by_mean, by_square, by_product])


def l1_dssim(image: Tensor, target: Tensor, weight: Tensor | None = None, *, dssim: float = 0.2) -> Tensor:
    """As ``losses.l1_dssim``, with tensors of one device."""
    with torch.no_grad():
        x, y = image.detach().permute(2, 0, 1), target.permute(2, 0, 1)
        count: Tensor | int = x.numel()
        if weight is not None:
            # Pixels that do not count show the target itself, so that the window carries nothing of them.
            x = x * weight + y * (1 - weight)
            count = (3 * weight.sum()).clamp_min(1.0)
        unlike, by_blurred = _dissimilarity(x, y)
        by_mean, by_square, by_product = _blurred(by_blurred).view(3, *x.shape)
        gradient = by_mean.addcmul_(x, by_square, value=2).addcmul_(y, by_product).mul_(-dssim)
        difference = x - y
        gradient += (1 - dssim) * torch.sign(difference)
        gradient *= 1 / count if weight is None else weight / count
        value = ((1 - dssim) * difference.abs_().sum() + dssim * unlike) / count
    found: Tensor = _WithGradient.apply(value, gradient.permute(1, 2, 0), image)  # type: ignore[no-untyped-call]
    return found


def semantic_cross_entropy(
    semantics: Tensor, alpha: Tensor, target: Tensor, *, sky_label: int | None, weight: Tensor | None = None
) -> Tensor:
    """As ``losses.semantic_cross_entropy``, with tensors of one device."""
    known = (target >= 0).to(alpha.dtype)
    counts = known if weight is None else known * weight
    picked = semantics.gather(2, target.clamp_min(0)[..., None])[..., 0]
    if sky_label is None:
        probability = picked / _at_least(alpha, FLOOR)
    else:
        is_sky = target == sky_label
        probability = torch.where(is_sky, 1 - alpha, picked)
    likelihood = torch.log(_at_least(probability, 0.0) + FLOOR)
    return -(likelihood * counts).sum() / counts.sum().clamp_min(1.0)


def normal_consistency(
    normal: Tensor, depth: Tensor, alpha: Tensor, rays: Tensor, weight: Tensor | None = None
) -> Tensor:
    """As ``losses.normal_consistency``, with tensors of one device."""
    height, width = depth.shape
    points = rays * (depth / _at_least(alpha, FLOOR))[..., None]
    along, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    surface = F.normalize(torch.linalg.cross(down, along, dim=2), dim=2)
    opaque = alpha.detach()[1:-1, 1:-1]
    error = opaque * (opaque - (surface * normal[1:-1, 1:-1]).sum(dim=2))
    if weight is not None:
        error = error * weight[1:-1, 1:-1]
    return error.sum() / max(1, (height - 2) * (width - 2))
