"""Losses against plain autograd references in float64, and where they must vanish."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unveil_core.base.parallel import threads
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.losses import camera_rays, l1_dssim, normal_consistency, semantic_cross_entropy


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


def reference_cross_entropy(
    semantics: Tensor, alpha: Tensor, target: Tensor, sky: int | None, weight: Tensor | None
) -> Tensor:
    known = target >= 0
    picked = semantics.gather(2, target.clamp_min(0)[..., None])[..., 0]
    probability = picked / alpha.clamp_min(1e-3) if sky is None else torch.where(target == sky, 1 - alpha, picked)
    w = known.to(alpha.dtype) if weight is None else weight * known
    return (-torch.log(probability.clamp_min(0) + 1e-3) * w).sum() / w.sum().clamp_min(1.0)


def reference_normal_consistency(
    normal: Tensor, depth: Tensor, alpha: Tensor, rays: Tensor, weight: Tensor | None
) -> Tensor:
    points = rays * (depth / alpha.clamp_min(1e-3))[..., None]
    along, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    surface = F.normalize(torch.linalg.cross(down, along, dim=2), dim=2)
    opaque = alpha.detach()[1:-1, 1:-1]
    error = opaque * (opaque - (surface * normal[1:-1, 1:-1]).sum(dim=2))
    return (error if weight is None else error * weight[1:-1, 1:-1]).mean()


def agree(loss: Tensor, inputs: list[Tensor], expected: Tensor, inputs64: list[Tensor]) -> None:
    """Value and every gradient, float32 against float64."""
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5, abs=1e-6)
    loss.backward()
    expected.backward()
    for mine, theirs in zip(inputs, inputs64, strict=True):
        assert mine.grad is not None and theirs.grad is not None
        assert float((mine.grad.double() - theirs.grad).norm()) <= 1e-4 * float(theirs.grad.norm()) + 1e-12


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("sky", [None, 2])
def test_cross_entropy_matches_autograd(sky: int | None, masked: bool) -> None:
    g = torch.Generator().manual_seed(5)
    semantics = torch.rand(19, 27, 4, generator=g) * 0.25
    alpha = torch.rand(19, 27, generator=g)
    alpha[0, :5] = 0
    alpha[1, :5] = 1 + 1e-4
    target = torch.randint(-1, 4, (19, 27), generator=g)
    weight = torch.rand(19, 27, generator=g) if masked else None
    inputs = [semantics.clone().requires_grad_(True), alpha.clone().requires_grad_(True)]
    inputs64 = [semantics.double().requires_grad_(True), alpha.double().requires_grad_(True)]
    loss = semantic_cross_entropy(inputs[0], inputs[1], target, sky_label=sky, weight=weight)
    weight64 = None if weight is None else weight.double()
    agree(2 * loss, inputs, 2 * reference_cross_entropy(*inputs64, target, sky, weight64), inputs64)


@pytest.mark.parametrize("masked", [False, True])
def test_normal_consistency_matches_autograd(masked: bool) -> None:
    g = torch.Generator().manual_seed(6)
    camera = Camera(33, 21, 30.0, 31.0, 16.0, 10.0, np.eye(4))
    rays = camera_rays(camera)
    alpha = 0.2 + 0.8 * torch.rand(21, 33, generator=g)
    depth = alpha * (3 + 4 * torch.rand(21, 33, generator=g))
    normal = torch.randn(21, 33, 3, generator=g)
    weight = torch.rand(21, 33, generator=g) if masked else None
    inputs = [t.clone().requires_grad_(True) for t in (normal, depth, alpha)]
    inputs64 = [t.double().requires_grad_(True) for t in (normal, depth, alpha)]
    weight64 = None if weight is None else weight.double()
    loss = normal_consistency(*inputs, rays, weight)
    agree(loss, inputs, reference_normal_consistency(*inputs64, rays.double(), weight64), inputs64)


def test_flat_and_empty_depth_have_finite_gradients() -> None:
    camera = Camera(12, 9, 10.0, 10.0, 6.0, 4.5, np.eye(4))
    for value in (0.0, 1e-30, 1e8):
        depth, alpha = torch.full((9, 12), value, requires_grad=True), torch.zeros(9, 12, requires_grad=True)
        normal = torch.zeros(9, 12, 3, requires_grad=True)
        normal_consistency(normal, depth, alpha, camera_rays(camera)).backward()
        for t in (depth, alpha, normal):
            assert t.grad is not None and bool(torch.isfinite(t.grad).all())


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (40, 3), (97, 61)])
def test_images_of_any_size_and_any_number_of_threads(shape: tuple[int, int]) -> None:
    g = torch.Generator().manual_seed(7)
    x, y = torch.rand(*shape, 3, generator=g), torch.rand(*shape, 3, generator=g)
    results = []
    for count in (1, 3):
        with threads(count):
            leaf = x.clone().requires_grad_(True)
            loss = l1_dssim(leaf, y)
            loss.backward()
            results.append((loss.item(), leaf.grad))
    assert results[0][0] == results[1][0]
    assert torch.equal(results[0][1], results[1][1])
    assert results[0][0] == pytest.approx(float(reference_l1_dssim(x.double(), y.double(), None, 0.2)), abs=2e-6)
