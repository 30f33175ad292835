"""The paper's losses (*3D StreetUnveiler*, section 3.1; *2D Gaussian Splatting*, section 5).

Each takes rendered planes and returns a scalar tensor; weights live in :class:`LossWeights`. Images are (H, W, 3) in [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.geometry.camera import Camera

__all__ = ["LossWeights", "camera_rays", "l1_dssim", "normal_consistency", "semantic_cross_entropy"]

_C1, _C2 = 0.01**2, 0.03**2
_WINDOW = (11, 11)
_SIGMA = 1.5


@dataclass(frozen=True)
class LossWeights:
    """Weights of the paper; zero switches a term off and spares its planes."""

    dssim: float = 0.2
    distortion: float = 100.0
    normal: float = 0.05
    label_distortion: float = 100.0
    semantic: float = 0.1
    opacity: float = 0.001


def _blur(image: NDArray[np.float32]) -> NDArray[np.float32]:
    # A zero border makes the blur a symmetric operator, so that it is its own adjoint in the backward pass.
    return cv2.GaussianBlur(image, _WINDOW, _SIGMA, borderType=cv2.BORDER_CONSTANT)


class _L1Dssim(torch.autograd.Function):
    """L1 and D-SSIM of one image with a hand-written gradient: eight separable blurs instead of autograd's thirty passes."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, weight: Tensor | None, dssim: float) -> Tensor:
        x, y = image.detach().numpy(), target.numpy()
        w = None if weight is None else weight.numpy()[..., None]
        if w is not None:
            # Pixels that do not count show the target itself, so that the window carries nothing of them.
            x = x * w + y * (1 - w)
        count = float(x.size if w is None else max(3.0 * float(w.sum()), 1.0))
        difference = x - y
        loss = (1 - dssim) * float(np.abs(difference, dtype=np.float64).sum()) / count
        gradient = np.sign(difference) * np.float32((1 - dssim) / count)
        if dssim > 0:
            mx, my = _blur(x), _blur(y)
            vx, vy, cov = _blur(x * x) - mx * mx, _blur(y * y) - my * my, _blur(x * y) - mx * my
            a1, a2 = 2 * mx * my + _C1, 2 * cov + _C2
            b1, b2 = mx * mx + my * my + _C1, vx + vy + _C2
            inverse = 1.0 / (b1 * b2)
            ssim = a1 * a2 * inverse
            loss += dssim * (1.0 - float(ssim.mean(dtype=np.float64))) * x.size / count
            # ssim as a function of the blurred x, x*x and x*y (Wang et al. 2004, equation 13)
            d_xx = -ssim / b2
            d_xy = 2 * a1 * inverse
            d_mx = 2 * (my * a2 * inverse - mx * ssim / b1) - 2 * mx * d_xx - my * d_xy
            back = _blur(d_mx) + 2 * x * _blur(d_xx) + y * _blur(d_xy)
            gradient -= np.float32(dssim / count) * back
        if w is not None:
            gradient = gradient * w
        ctx.gradient = torch.from_numpy(np.ascontiguousarray(gradient, dtype=np.float32))
        return image.new_tensor(loss)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        return ctx.gradient * grad_outputs[0], None, None, None


def l1_dssim(image: Tensor, target: Tensor, weight: Tensor | None = None, *, dssim: float = 0.2) -> Tensor:
    """``(1 - dssim) * L1 + dssim * (1 - SSIM)``, means over the pixels that count.

    Args:
        image: (H, W, 3) float32, differentiable; target: (H, W, 3) float32.
        weight: (H, W) float32 in [0, 1], 0 = the pixel does not count; None = all count.
        dssim: share of the structural term (3DGS: 0.2).
    """
    result: Tensor = _L1Dssim.apply(image, target, weight, dssim)  # type: ignore[no-untyped-call]
    return result


def semantic_cross_entropy(
    semantics: Tensor, alpha: Tensor, target: Tensor, *, sky_label: int | None, weight: Tensor | None = None
) -> Tensor:
    """L_s: cross entropy of the rendered labels.

    What light passes the surfels belongs to the sky, so the probability of *sky* is ``1 - alpha``; in a scene without
    that label the rendered weights are normalized by alpha instead.

    Args:
        semantics: (H, W, K) accumulated label weights; alpha: (H, W).
        target: (H, W) int64 compact labels, negative = ignore.
        sky_label: the compact label of the sky, or None.
    """
    known = target >= 0
    picked = semantics.gather(2, target.clamp_min(0)[..., None])[..., 0]
    by_alpha = picked / alpha.clamp_min(1e-3)
    probability = by_alpha if sky_label is None else torch.where(target == sky_label, 1 - alpha, picked)
    nll = -torch.log(probability.clamp_min(0) + 1e-3)
    w = known.to(nll.dtype) if weight is None else weight * known
    return (nll * w).sum() / w.sum().clamp_min(1.0)


def camera_rays(camera: Camera) -> Tensor:
    """(H, W, 3) float32 rays in the camera's frame with unit z."""
    xs = (torch.arange(camera.width, dtype=torch.float64) + 0.5 - camera.cx) / camera.fx
    ys = (torch.arange(camera.height, dtype=torch.float64) + 0.5 - camera.cy) / camera.fy
    x, y = xs.expand(camera.height, -1), ys[:, None].expand(-1, camera.width)
    return torch.stack([x, y, torch.ones_like(x)], dim=2).float()


def normal_consistency(
    normal: Tensor, depth: Tensor, alpha: Tensor, rays: Tensor, weight: Tensor | None = None
) -> Tensor:
    """L_n: the rendered normal against the normal of the rendered depth (2DGS, equation 14).

    Args:
        normal: (H, W, 3) accumulated normals in the camera's frame; depth: (H, W) accumulated; alpha: (H, W).
        rays: (H, W, 3) of :func:`camera_rays`.
    """
    points = rays * (depth / alpha.clamp_min(1e-3))[..., None]
    dx = points[1:-1, 2:] - points[1:-1, :-2]
    dy = points[2:, 1:-1] - points[:-2, 1:-1]
    surface = F.normalize(torch.linalg.cross(dy, dx, dim=2), dim=2)
    opaque = alpha.detach()[1:-1, 1:-1]
    error = opaque * (opaque - (surface * normal[1:-1, 1:-1]).sum(dim=2))
    if weight is not None:
        error = error * weight[1:-1, 1:-1]
    return error.mean()
