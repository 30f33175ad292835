"""Losses against plain autograd references in float64, and where they must vanish."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.optimize.losses import camera_rays, l1_dssim, normal_consistency, semantic_cross_entropy


def reference_l1_dssim(x: Tensor, y: Tensor, weight: Tensor | None, dssim: float) -> Tensor:
    """The textbook form: 11x11 Gaussian window, zero border, masked pixels replaced by the target."""
    w = torch.ones(x.shape[:2], dtype=x.dtype) if weight is None else weight
    x = x * w[..., None] + y * (1 - w[..., None])
    count = 3 * w.sum()
    g = torch.exp(-((torch.arange(11, dtype=x.dtype) - 5) ** 2) / (2 * 1.5**2))
    g = g / g.sum()
    kernel = (g[:, None] * g[None, :])[None, None]

    def blur(image: Tensor) -> Tensor:
        return F.conv2d(image.permute(2, 0, 1)[:, None], kernel, padding=5)[:, 0].permute(1, 2, 0)

    mx, my = blur(x), blur(y)
    vx, vy, cov = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    ssim = ((2 * mx * my + 1e-4) * (2 * cov + 9e-4)) / ((mx * mx + my * my + 1e-4) * (vx + vy + 9e-4))
    return (1 - dssim) * (x - y).abs().sum() / count + dssim * (1 - ssim).sum() / count


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("dssim", [0.0, 0.2, 1.0])
def test_l1_dssim_matches_autograd(masked: bool, dssim: float) -> None:
    generator = torch.Generator().manual_seed(3)
    y = torch.rand(23, 31, 3, generator=generator)
    x = (y + 0.1 * torch.randn(23, 31, 3, generator=generator)).clamp(0, 1)
    weight = (torch.rand(23, 31, generator=generator) > 0.3).float() if masked else None
    x32 = x.clone().requires_grad_(True)
    loss = l1_dssim(x32, y, weight, dssim=dssim)
    loss.backward()
    x64 = x.double().requires_grad_(True)
    expected = reference_l1_dssim(x64, y.double(), None if weight is None else weight.double(), dssim)
    expected.backward()
    assert abs(loss.item() - expected.item()) < 2e-6
    assert x32.grad is not None and x64.grad is not None
    assert float((x32.grad.double() - x64.grad).norm() / x64.grad.norm()) < 2e-4


def test_equal_images_cost_nothing() -> None:
    y = torch.rand(16, 16, 3)
    assert l1_dssim(y.clone(), y).item() == pytest.approx(0.0, abs=1e-6)


def test_masked_pixels_get_no_gradient() -> None:
    y = torch.rand(20, 20, 3)
    x = torch.rand(20, 20, 3, requires_grad=True)
    weight = torch.ones(20, 20)
    weight[5:10, 5:10] = 0
    l1_dssim(x, y, weight).backward()
    assert x.grad is not None
    assert float(x.grad[5:10, 5:10].abs().max()) == 0
    assert float(x.grad[12:, 12:].abs().max()) > 0


def test_cross_entropy_gives_what_is_not_covered_to_the_sky() -> None:
    semantics = torch.zeros(2, 2, 3)
    alpha = torch.zeros(2, 2)
    target = torch.full((2, 2), 2)
    clear = semantic_cross_entropy(semantics, alpha, target, sky_label=2)
    covered = semantic_cross_entropy(semantics, torch.ones(2, 2), target, sky_label=2)
    assert clear.item() < 0.01 < covered.item()
    ignored = semantic_cross_entropy(semantics, alpha, torch.full((2, 2), -1), sky_label=2)
    assert ignored.item() == 0


def test_normals_of_a_rendered_plane_agree() -> None:
    camera = Camera(40, 30, 35.0, 35.0, 20.0, 15.0, np.eye(4))
    rays = camera_rays(camera)
    normal = torch.tensor([0.2, -0.3, -1.0])
    normal = normal / normal.norm()
    depth = float(normal[2]) * 5.0 / (rays @ normal)
    plane = normal.expand(30, 40, 3)
    alpha = torch.ones(30, 40)
    assert normal_consistency(plane, depth, alpha, rays).item() == pytest.approx(0.0, abs=1e-5)
    tilted = torch.tensor([0.0, 0.0, -1.0]).expand(30, 40, 3)
    assert normal_consistency(tilted, depth, alpha, rays).item() > 0.03
