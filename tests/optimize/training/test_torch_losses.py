"""The torch losses and Adam against the fused ones: one value, one gradient, whatever a step may give them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from unveil_core.base.parallel import threads
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training import losses, torch_losses
from unveil_core.optimize.training.adam import adam_step
from unveil_core.optimize.training.arithmetic import FUSED, TORCH, arithmetic_for
from unveil_core.optimize.training.torch_adam import adam_step as torch_adam_step
from unveil_core.surfels.sky import Sky

TOLERANCE = 1e-5
THERE = "cuda" if torch.cuda.is_available() else "cpu"
"""Where the torch code works: on a GPU where there is one."""
seeds = st.integers(0, 2**31)
sides = st.integers(1, 40)


def agree(fused: Callable[..., Tensor], by_torch: Callable[..., Tensor], *inputs: Tensor, summed: int = 1) -> None:
    """Value and each gradient: the greatest difference against the greatest gradient.

    Args:
        summed: of how many numbers a value is the sum, where it is no mean.
    """
    results = []
    for loss, device in ((fused, "cpu"), (by_torch, THERE)):
        leaves = [x.clone().to(device).requires_grad_(True) for x in inputs]
        value = loss(*leaves)
        (3.0 * value).backward()  # what comes from behind is passed on
        results.append((value.item(), [leaf.grad for leaf in leaves]))
    (one, ones), (other, others) = results
    assert other == pytest.approx(one, rel=TOLERANCE, abs=TOLERANCE * summed)
    for a, b in zip(ones, others, strict=True):
        assert a is not None and b is not None
        assert float((a - b.cpu()).abs().max()) <= TOLERANCE * max(1.0, float(a.abs().max()))


def there(tensor: Tensor | None) -> Tensor | None:
    return None if tensor is None else tensor.to(THERE)


def masks(generator: torch.Generator, height: int, width: int, kind: str) -> Tensor | None:
    if kind == "none":
        return None
    return (torch.rand(height, width, generator=generator) > (1.1 if kind == "empty" else 0.3)).float()


kinds = st.sampled_from(["none", "some", "empty"])


@settings(max_examples=25)
@given(seeds, sides, sides, kinds, st.sampled_from([0.0, 0.2, 1.0]))
def test_l1_dssim(seed: int, height: int, width: int, kind: str, dssim: float) -> None:
    g = torch.Generator().manual_seed(seed)
    target = torch.rand(height, width, 3, generator=g)
    image = target + 0.2 * torch.randn(height, width, 3, generator=g)
    image[: height // 2, 0] = target[: height // 2, 0]  # where they are equal, L1 has no slope
    weight = masks(g, height, width, kind)
    agree(
        lambda x: losses.l1_dssim(x, target, weight, dssim=dssim),
        lambda x: torch_losses.l1_dssim(x, target.to(THERE), there(weight), dssim=dssim),
        image,
        summed=image.numel() if kind == "empty" else 1,  # where nothing counts it is divided by one
    )


@settings(max_examples=25)
@given(seeds, sides, sides, st.sampled_from([2, 8, 64]))
def test_over_sky(seed: int, height: int, width: int, rows: int) -> None:
    g = torch.Generator().manual_seed(seed)
    sky = Sky(torch.rand(3, rows, 2 * rows, generator=g), np.eye(3))
    positions = 2.4 * torch.rand(1, height, width, 2, generator=g) - 1.2  # some beyond the borders
    told = torch.rand(height, width, 3, generator=g)
    arguments = torch.rand(height, width, 3, generator=g), torch.rand(height, width, generator=g), sky.texture
    agree(
        lambda rgb, alpha, texture: (losses.over_sky(rgb, alpha, sky, texture, positions) * told).mean(),
        lambda rgb, alpha, texture: (
            torch_losses.over_sky(rgb, alpha, sky, texture, positions.to(THERE)) * told.to(THERE)
        ).mean(),
        *arguments,
    )


def test_the_gradient_of_the_sky_has_the_same_bits_for_any_number_of_threads() -> None:
    g = torch.Generator().manual_seed(0)
    sky = Sky(torch.rand(3, 16, 32, generator=g), np.eye(3))
    positions = 2 * torch.rand(1, 130, 90, 2, generator=g) - 1
    rgb, alpha = torch.rand(130, 90, 3, generator=g), torch.rand(130, 90, generator=g)
    found = []
    for count in (1, 2, 5):
        texture = sky.texture.clone().requires_grad_(True)
        with threads(count):
            losses.over_sky(rgb, alpha, sky, texture, positions).square().sum().backward()
        found.append(texture.grad)
    assert all(torch.equal(f, found[0]) for f in found)  # type: ignore[arg-type]


@settings(max_examples=25)
@given(seeds, sides, sides, kinds, st.booleans())
def test_cross_entropy(seed: int, height: int, width: int, kind: str, sky: bool) -> None:
    g = torch.Generator().manual_seed(seed)
    alpha = torch.rand(height, width, generator=g) * (torch.rand(height, width, generator=g) > 0.2)
    semantics = torch.softmax(torch.randn(height, width, 4, generator=g), dim=2) * alpha[..., None]
    target = torch.randint(-1, 4, (height, width), generator=g)
    weight, label = masks(g, height, width, kind), 3 if sky else None
    agree(
        lambda s, a: losses.semantic_cross_entropy(s, a, target, sky_label=label, weight=weight),
        lambda s, a: torch_losses.semantic_cross_entropy(s, a, target.to(THERE), sky_label=label, weight=there(weight)),
        semantics,
        alpha,
    )


@settings(max_examples=25)
@given(seeds, sides, sides, kinds)
def test_normals(seed: int, height: int, width: int, kind: str) -> None:
    g = torch.Generator().manual_seed(seed)
    rays = losses.camera_rays(Camera(width, height, 30.0, 30.0, width / 2, height / 2, np.eye(4)))
    alpha = torch.rand(height, width, generator=g) * 0.9 + 0.05
    depth = alpha * (3 + torch.rand(height, width, generator=g))
    normal = torch.nn.functional.normalize(torch.randn(height, width, 3, generator=g), dim=2) * alpha[..., None]
    weight = masks(g, height, width, kind)
    agree(
        lambda n, d, a: losses.normal_consistency(n, d, a, rays, weight),
        lambda n, d, a: torch_losses.normal_consistency(n, d, a, rays.to(THERE), there(weight)),
        normal,
        depth,
        alpha,
    )


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize(("shape", "rest_rate"), [((7,), None), ((7, 2), None), ((7, 4, 3), 3e-3), ((0, 3), None)])
def test_adam(shape: tuple[int, ...], rest_rate: float | None, moves: bool) -> None:
    g = torch.Generator().manual_seed(1)
    moving = torch.rand(shape[0], generator=g) > 0.4 if moves else None
    start = torch.randn(shape, generator=g)
    found = []
    for step, device in ((adam_step, "cpu"), (torch_adam_step, THERE)):
        x, first, second = (v.clone().to(device) for v in (start, torch.zeros(shape), torch.zeros(shape)))
        some = None if moving is None else moving.to(device)
        again = torch.Generator().manual_seed(2)
        for turn in range(1, 30):
            gradient = torch.randn(shape, generator=again) * 10.0 ** (turn % 5 - 4)
            step(x, gradient.to(device), first, second, some, turn=turn, rate=1e-2, rest_rate=rest_rate)
        found.append((x.cpu(), first.cpu(), second.cpu()))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(other, one, rtol=TOLERANCE, atol=1e-6)
    if moving is not None:
        assert torch.equal(found[1][0][~moving], start[~moving])


def test_who_asks_for_what_gets_it() -> None:
    there, here = torch.device("meta"), torch.device("cpu")
    assert arithmetic_for("auto", here) is FUSED is arithmetic_for("fused", here)
    assert arithmetic_for("auto", there) is TORCH is arithmetic_for("torch", here)
    with pytest.raises(ValueError, match="the fused kernels work on the processor, not on meta"):
        arithmetic_for("fused", there)
    with pytest.raises(ValueError, match="not kernels: 'fast'"):
        arithmetic_for("fast", here)
