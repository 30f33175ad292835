"""The paper's losses (*3D StreetUnveiler*, section 3.1; *2D Gaussian Splatting*, section 5).

Each takes rendered planes and returns a scalar tensor; weights live in :class:`LossWeights`. Images are (H, W, 3) in [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.array_pool import borrow, give_back
from unveil_core.base.parallel import in_parallel
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training import loss_kernels as kernels
from unveil_core.surfels.sky import Sky

__all__ = [
    "LossWeights",
    "camera_rays",
    "depth_prior",
    "l1_dssim",
    "normal_consistency",
    "over_sky",
    "semantic_cross_entropy",
]


@dataclass(frozen=True)
class LossWeights:
    """Weights of the paper; zero switches a term off and spares its planes. ``depth`` is not of the paper: it is for views
    with an expected depth."""

    dssim: float = 0.2
    distortion: float = 100.0
    normal: float = 0.05
    label_distortion: float = 100.0
    semantic: float = 0.1
    opacity: float = 0.001
    depth: float = 0.0


ROWS_AT_ONCE = 16
SKY_BANDS = 16
"""Parts of a picture whose gradients by the sky are summed up one after the other: the same for any number of threads."""
_TAPS = kernels.window()
_EVERYWHERE = np.zeros((0, 0), np.float32)


class _WithGradients(torch.autograd.Function):
    """A scalar whose gradients by its inputs are known already."""

    @staticmethod
    def forward(ctx: Any, value: float, gradients: tuple[NDArray[np.float32], ...], *inputs: Tensor) -> Tensor:
        ctx.gradients = gradients
        return inputs[0].new_tensor(value)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        gradients, ctx.gradients = ctx.gradients, ()  # they are scaled in place: no backward goes twice over one render
        scale = grad_outputs[0].item()
        return (
            None,
            None,
            *(torch.from_numpy(g) if scale == 1.0 else torch.from_numpy(g).mul_(scale) for g in gradients),
        )


def _with_gradients(value: float, gradients: tuple[NDArray[np.float32], ...], *inputs: Tensor) -> Tensor:
    result: Tensor = _WithGradients.apply(value, gradients, *inputs)  # type: ignore[no-untyped-call]
    return result


def _array(tensor: Tensor) -> NDArray[Any]:
    array: NDArray[Any] = tensor.detach().contiguous().numpy()
    return array


class _OverSky(torch.autograd.Function):
    """See :func:`over_sky`."""

    @staticmethod
    def forward(ctx: Any, rgb: Tensor, alpha: Tensor, texture: Tensor, grid: Tensor) -> Tensor:
        c, a, t, g = _array(rgb), _array(alpha), _array(texture), _array(grid)[0]
        image, sky = np.empty_like(c), np.empty_like(c)
        in_parallel(kernels.sky_rows, len(a), ROWS_AT_ONCE, c, a, g, t, sky, image)
        ctx.of_sky = (a, g, sky, t.shape)
        return torch.from_numpy(image)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
        alpha, grid, sky, shape = ctx.of_sky
        by_alpha, by_texture = np.empty_like(alpha), np.zeros((SKY_BANDS, *shape), np.float32)
        rows = -(-len(alpha) // SKY_BANDS)
        arrays = (rows, alpha, grid, sky, _array(grad_outputs[0]), by_alpha, by_texture)
        in_parallel(kernels.sky_gradient, SKY_BANDS, 1, *arrays)
        return grad_outputs[0], torch.from_numpy(by_alpha), torch.from_numpy(by_texture.sum(axis=0)), None


def over_sky(rgb: Tensor, alpha: Tensor, sky: Sky, texture: Tensor, positions: Tensor) -> Tensor:
    """(H, W, 3) a rendered colour with the sky where it leaves light through, differentiable in all but the positions.

    Args:
        rgb: (H, W, 3); alpha: (H, W); sky: what ``texture`` (3, E, A) is of.
        positions: (1, H, W, 2) where it is sampled, see ``Sky.grid``.
    """
    image: Tensor = _OverSky.apply(rgb, alpha, texture, positions)  # type: ignore[no-untyped-call]
    return image


def l1_dssim(image: Tensor, target: Tensor, weight: Tensor | None = None, *, dssim: float = 0.2) -> Tensor:
    """``(1 - dssim) * L1 + dssim * (1 - SSIM)``, means over the pixels that count.

    Args:
        image: (H, W, 3) float32, differentiable; target: (H, W, 3) float32.
        weight: (H, W) float32 in [0, 1], 0 = the pixel does not count; None = all count.
        dssim: share of the structural term (3DGS: 0.2).
    """
    height, width = image.shape[:2]
    x, y = _array(image).reshape(height, 3 * width), _array(target).reshape(height, 3 * width)
    w = None if weight is None else np.repeat(weight.numpy(), 3, axis=1)
    if w is not None:
        # Pixels that do not count show the target itself, so that the window carries nothing of them.
        x = x * w + y * (1 - w)
    count = float(x.size if w is None else max(float(w.sum()), 1.0))
    buffers = borrow()
    maps = [buffers.array(name, x.shape) for name in ("by_mean", "by_square", "by_product")]
    ssim, difference = np.empty(height, np.float32), np.empty(height, np.float32)
    in_parallel(kernels.ssim_rows, height, ROWS_AT_ONCE, x, y, _TAPS, ssim, difference, *maps)
    gradient = np.empty_like(x)
    scales = np.float32((1 - dssim) / count), np.float32(dssim / count)
    in_parallel(kernels.l1_dssim_gradient, height, ROWS_AT_ONCE, x, y, _TAPS, *maps, *scales, gradient)
    give_back(buffers)
    if w is not None:
        gradient *= w
    l1, structure = float(difference.sum(dtype=np.float64)), x.size - float(ssim.sum(dtype=np.float64))
    value = ((1 - dssim) * l1 + dssim * structure) / count
    return _with_gradients(value, (gradient.reshape(height, width, 3),), image)


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
    known = target.numpy() >= 0
    w = _EVERYWHERE if weight is None else weight.numpy()
    count = max(1.0, float(known.sum() if weight is None else (w * known).sum(dtype=np.float64)))
    sums = np.empty(len(known))
    gradients = np.empty(semantics.shape, np.float32), np.empty(alpha.shape, np.float32)
    in_parallel(
        kernels.cross_entropy_rows,
        len(known),
        ROWS_AT_ONCE,
        _array(semantics),
        _array(alpha),
        target.numpy(),
        w,
        -1 if sky_label is None else sky_label,
        np.float32(1 / count),
        sums,
        *gradients,
    )
    return _with_gradients(float(sums.sum()) / count, gradients, semantics, alpha)


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
    n, d, a, r = _array(normal), _array(depth), _array(alpha), _array(rays)
    height, width = d.shape
    count = max(1, (height - 2) * (width - 2))
    w = _EVERYWHERE if weight is None else weight.numpy()
    buffers = borrow()
    along, down = buffers.array("along", n.shape), buffers.array("down", n.shape)
    sums, g_normal = np.empty(height), np.empty_like(n)
    scale = np.float32(1 / count)
    in_parallel(kernels.normal_rows, height, ROWS_AT_ONCE, n, d, a, r, w, scale, sums, g_normal, along, down)
    g_depth, g_alpha = np.empty_like(d), np.empty_like(d)
    in_parallel(kernels.normal_to_depth, height, ROWS_AT_ONCE, d, a, r, along, down, g_depth, g_alpha)
    give_back(buffers)
    return _with_gradients(float(sums.sum()) / count, (g_normal, g_depth, g_alpha), normal, depth, alpha)


def depth_prior(depth: Tensor, alpha: Tensor, expected: Tensor) -> Tensor:
    """Relative difference of the rendered from an expected depth, the mean over the image.

    As the depth term of *SPIn-NeRF* (Mirzaei et al., CVPR 2023, section 3.2), but absolute and relative, so that far
    pixels do not outweigh near ones.

    Args:
        depth: (H, W) accumulated, not divided by alpha; alpha: (H, W); expected: (H, W), 0 = none.
    """
    counts = expected > 0
    share = torch.where(counts, 1 / expected.clamp_min(1e-6), 0.0)
    return ((depth - alpha * expected).abs() * share).mean()
