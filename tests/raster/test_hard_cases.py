"""Degenerate scenes: finite images and gradients, and the same ones as the float64 reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.raster.hard_cases import CASES, SIZES, HardCase
from tests.raster.scenes import GRADIENTS, camera, for_backend, random_surfels, with_gradients
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, Rendered, render
from unveil_core.raster.reference import render_reference
from unveil_core.surfels.surfels import Surfels


def run(surfels: Surfels, view: Camera, backend: str, label_count: int) -> tuple[Rendered, dict[str, torch.Tensor]]:
    """All planes, and the gradients of their sum."""
    leaves = with_gradients(for_backend(surfels, backend))
    out = render(leaves, view, PLANES, label_count=label_count, backend=backend)
    sum(getattr(out, plane).sum() for plane in PLANES).backward()  # type: ignore[union-attr]
    # On a GPU the planes come back to be compared.
    planes = {plane: getattr(out, plane).cpu() for plane in PLANES}
    gradients = {name: getattr(leaves, name).grad.cpu() for name in GRADIENTS}
    return replace(out, **planes, visible=out.visible.cpu()), gradients


def assert_alike(case: HardCase, size: tuple[int, int], backend: str) -> None:
    """The backend keeps the case's stated error against float64."""
    view = case.camera(*size)
    out, gradients = run(case.surfels, view, backend, case.label_count)
    true = case.surfels if case.true_surfels is None else case.true_surfels
    expected, reference = run(true, case.camera(*size, true=True), "reference", case.label_count)
    alpha = expected.alpha
    assert alpha is not None and out.alpha is not None
    # Where a case may lose a pixel at the cut, that pixel is not compared.
    clear = (alpha > 1.5 / 255) if case.why else torch.ones_like(alpha, dtype=torch.bool)
    assert int(((out.alpha > 0) != (alpha > 0)).sum()) <= (0.01 * alpha.numel() if case.why else 0)
    for plane in PLANES:
        value, truth = getattr(out, plane).detach().double(), getattr(expected, plane).detach()
        assert value.shape == truth.shape
        assert bool(torch.isfinite(value).all()), plane
        error = (value - truth)[clear].abs()
        assert not error.numel() or float(error.max()) <= case.limit * max(1.0, float(truth.abs().max())), plane
    largest = max((float(g.double().norm()) for g in reference.values()), default=0.0)
    for name in GRADIENTS:
        a, b = gradients[name].double(), reference[name].double()
        assert bool(torch.isfinite(a).all()), name
        assert bool(torch.isfinite(b).all()), name
        if case.gradients:
            # Gradients that vanish but for rounding are held against the largest one.
            assert float((a - b).norm()) <= case.limit * max(float(b.norm()), 0.1 * largest), name
    assert bool(((~expected.visible) | out.visible).all()), "a contributing surfel is not visible"


@pytest.mark.parametrize("size", SIZES, ids=lambda s: f"{s[0]}x{s[1]}")
@pytest.mark.parametrize("name", CASES)
def test_hard_case_keeps_its_stated_error(name: str, size: tuple[int, int]) -> None:
    assert_alike(CASES[name], size, "cpu")


def test_limits_over_a_thousandth_say_why() -> None:
    assert all(case.limit <= 1e-3 or case.why for case in CASES.values())


@pytest.mark.parametrize("label_count", [1, 19])
def test_fewest_and_most_labels(label_count: int) -> None:
    surfels = random_surfels(120, 3, labels=label_count)
    out = render(surfels, camera(), ("semantics", "label_distortion", "alpha", "distortion"), label_count=label_count)
    truth = render_reference(surfels, camera(), label_count, near=0.2, far=100.0)
    keep = ~truth["undecided"]
    assert out.semantics is not None and out.semantics.shape == (32, 48, label_count)
    for plane in ("semantics", "label_distortion", "alpha", "distortion"):
        assert float((getattr(out, plane) - truth[plane])[keep].abs().max()) < 2e-5, plane
    if label_count == 1:
        # With one label the label distortion is the distortion, and its semantics the alpha.
        torch.testing.assert_close(out.label_distortion, out.distortion, atol=1e-6, rtol=1e-4)
        torch.testing.assert_close(out.semantics[..., 0], out.alpha, atol=1e-5, rtol=1e-4)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.integers(0, 10**6),
    st.floats(0.21, 2.0),
    st.floats(-1.0, 2.0),
    st.sampled_from([(1, 1), (5, 40), (31, 18), (33, 32)]),
)
def test_bounds_of_discs_at_the_near_plane_lose_no_pixel(
    seed: int, depth: float, log_scale: float, size: tuple
) -> None:  # type: ignore[type-arg]
    """The reference has no bounds at all; discs cut by the near plane must keep every pixel that they reach."""
    g = torch.Generator().manual_seed(seed)
    n = 4
    surfels = Surfels(
        means=torch.cat([torch.randn(n, 2, generator=g) * depth, torch.full((n, 1), depth)], dim=1),
        quats=torch.randn(n, 4, generator=g),
        log_scales=log_scale + 0.5 * torch.randn(n, 2, generator=g),
        opacity_logits=torch.full((n,), -1.0),
        sh=0.3 * torch.randn(n, 1, 3, generator=g),
        labels=torch.zeros(n, dtype=torch.int64),
    )
    view = Camera(*size, 30.0, 30.0, size[0] / 2, size[1] / 2, np.eye(4))
    out = render(surfels, view, ("alpha",))
    truth = render_reference(surfels, view, 1, near=0.2, far=100.0, outputs=("alpha",))
    assert out.alpha is not None
    wrong = (out.alpha - truth["alpha"]).abs() > 2e-3
    assert not bool((wrong & ~truth["undecided"]).any())


def test_nothing_is_lost_kilometres_from_the_origin() -> None:
    surfels = random_surfels(200, 4)
    # Positions that float32 holds exactly both here and there.
    here = Surfels(
        torch.round(surfels.means * 256) / 256,
        surfels.quats,
        surfels.log_scales,
        surfels.opacity_logits,
        surfels.sh,
        surfels.labels,
    )
    offset = np.array([8192.0, -4096.0, 128.0])
    there = Surfels(
        here.means + torch.from_numpy(offset).float(),
        here.quats,
        here.log_scales,
        here.opacity_logits,
        here.sh,
        here.labels,
    )
    view = camera()
    pose = view.world_to_camera.copy()
    pose[:3, 3] -= pose[:3, :3] @ offset
    moved = Camera(view.width, view.height, view.fx, view.fy, view.cx, view.cy, pose)
    a, b = render(here, view, ("rgb", "depth")), render(there, moved, ("rgb", "depth"))
    torch.testing.assert_close(a.rgb, b.rgb, atol=2e-6, rtol=0)
    torch.testing.assert_close(a.depth, b.depth, atol=1e-5, rtol=0)
