"""Degenerate scenes: finite images and gradients, and the same ones as the float64 reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.raster.scenes import GRADIENTS, camera, random_surfels, with_gradients
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, Rendered, render
from unveil_core.raster.reference import render_reference
from unveil_core.surfels.surfels import Surfels

HALF = math.sqrt(0.5)
LIE_DOWN, STAND_SIDEWAYS = (HALF, HALF, 0.0, 0.0), (HALF, 0.0, HALF, 0.0)
FACING = (1.0, 0.0, 0.0, 0.0)


def scene(means, quat=FACING, log_scales=(-1.0, -1.0), logit=2.0, degree=1) -> Surfels:  # type: ignore[no-untyped-def]
    positions = torch.tensor(means, dtype=torch.float32).reshape(-1, 3)
    n = len(positions)
    g = torch.Generator().manual_seed(0)
    return Surfels(
        means=positions,
        quats=torch.tensor(quat).expand(n, 4).clone(),
        log_scales=torch.tensor(log_scales).expand(n, 2).clone(),
        opacity_logits=torch.full((n,), float(logit)),
        sh=0.3 * torch.randn(n, (degree + 1) ** 2, 3, generator=g),
        labels=torch.arange(n) % 3,
    )


def straight(width: int, height: int) -> Camera:
    return Camera(width, height, 30.0, 30.0, width / 2, height / 2, np.eye(4))


PAIR = [[0.0, 0.0, 3.0], [0.05, 0.05, 3.5]]
CASES = {
    "edge-on, lying": (scene([[0, 0, 3], [0.1, 0.2, 4]], LIE_DOWN), 2e-5),
    "edge-on, lying, on a row of pixel centres": (scene([[0, 0, 3]], LIE_DOWN), 2e-5),
    "edge-on, standing": (scene([[0, 0, 3]], STAND_SIDEWAYS), 2e-5),
    "crosses the camera's plane": (scene([[0, 0.5, 0.5], [0, 0.5, 1.0]], LIE_DOWN, (0.5, 0.5)), 2e-5),
    "centre behind, edge in front": (scene([[0, 0.5, -0.5]], LIE_DOWN, (0.5, 0.5)), 2e-5),
    "centre nearer than near": (scene([[0, 0.1, 0.1]], LIE_DOWN, (0.5, 0.5)), 2e-5),
    "a micrometre": (scene(PAIR, log_scales=(math.log(1e-6),) * 2), 2e-5),
    "a kilometre": (scene([[0, 0, 3], [0, 1, 5]], (0.9, 0.3, 0.1, 0.0), (math.log(1e3),) * 2), 1e-4),
    "no scale at all": (scene(PAIR, log_scales=(-200.0, -200.0)), 2e-5),
    "no scale along one axis": (scene(PAIR, log_scales=(-200.0, 0.0)), 2e-5),
    "scale beyond float": (scene([[0, 0, 3]], (0.9, 0.3, 0.1, 0.0), (200.0, 200.0)), 2e-5),
    "opacity 0": (scene(PAIR, logit=-200.0), 2e-5),
    "opacity 1": (scene(PAIR, logit=200.0), 2e-5),
    "zero quaternion": (scene(PAIR, (0.0, 0.0, 0.0, 0.0)), 2e-5),
    "huge quaternion": (scene(PAIR, (1e18, 0.0, 1e17, 0.0)), 2e-5),
    "a thousand opaque layers": (scene([[0, 0, 3 + 0.01 * i] for i in range(1000)], logit=10.0), 2e-5),
    "a thousand thin layers": (scene([[0, 0, 3 + 0.01 * i] for i in range(1000)], logit=-5.3), 2e-4),
    "equal depths": (scene([[0.01 * i, 0, 3] for i in range(50)]), 2e-5),
    "the same surfel twenty times": (scene([[0.02, 0.03, 3]] * 20), 2e-5),
    "beyond what float32 can place": (
        scene([[1e30, 0, 3], [1e9, 0, 0.3], [0, 0, 1e30]], log_scales=(10.0, 10.0)),
        2e-5,
    ),
    "empty": (scene(np.zeros((0, 3)).tolist()), 2e-5),
}


def run(surfels: Surfels, view: Camera, backend: str, label_count: int) -> tuple[Rendered, dict[str, torch.Tensor]]:
    leaves = with_gradients(surfels)
    out = render(leaves, view, PLANES, label_count=label_count, backend=backend)
    sum(getattr(out, plane).sum() for plane in PLANES).backward()  # type: ignore[union-attr]
    return out, {name: getattr(leaves, name).grad for name in GRADIENTS}


def assert_alike(surfels: Surfels, view: Camera, limit: float, label_count: int = 3) -> None:
    out, gradients = run(surfels, view, "cpu", label_count)
    expected, reference = run(surfels, view, "reference", label_count)
    for plane in PLANES:
        value, truth = getattr(out, plane).detach().double(), getattr(expected, plane).detach()
        assert value.shape == truth.shape
        assert bool(torch.isfinite(value).all()), plane
        assert float((value - truth).abs().amax()) <= limit * max(1.0, float(truth.abs().amax())), plane
    largest = max((float(g.double().norm()) for g in reference.values()), default=0.0)
    for name in GRADIENTS:
        a, b = gradients[name].double(), reference[name].double()
        assert bool(torch.isfinite(a).all()), name
        assert bool(torch.isfinite(b).all()), name
        # Gradients that vanish but for rounding are held against the largest one.
        assert float((a - b).norm()) <= limit * max(float(b.norm()), 0.1 * largest), name
    assert bool(((~expected.visible) | out.visible).all()), "a contributing surfel is not visible"


@pytest.mark.parametrize("size", [(37, 21), (1, 1), (16, 16), (17, 33)], ids=lambda s: f"{s[0]}x{s[1]}")
@pytest.mark.parametrize("case", CASES)
def test_hard_case_matches_the_reference(case: str, size: tuple[int, int]) -> None:
    surfels, limit = CASES[case]
    assert_alike(surfels, straight(*size), limit)


def test_far_centre_and_near_edge_stays_finite_and_close() -> None:
    """A disc of a kilometre whose centre lies 300,000 pixels aside, where float32 places it to a thirtieth of a pixel.

    The stated error is 1 % where alpha is clear of the cut at 1/255 (measured: a quarter of that), and one pixel in a
    hundred may fall on the other side of the cut; the gradient by the mean is only promised to be finite.
    """
    surfels = scene([[3000, 0, 0.3]], (0.9, 0.3, 0.5, 0.0), (7.0, 7.0))
    out, gradients = run(surfels, straight(37, 21), "cpu", 3)
    expected, _ = run(surfels, straight(37, 21), "reference", 3)
    alpha = expected.alpha.detach()  # type: ignore[union-attr]
    clear = alpha > 1.5 / 255
    assert int(clear.sum()) > 80
    assert int(((out.alpha > 0) != (alpha > 0)).sum()) <= 0.01 * alpha.numel()  # type: ignore[operator]
    for plane in PLANES:
        value, truth = getattr(out, plane).detach().double(), getattr(expected, plane).detach()
        assert bool(torch.isfinite(value).all())
        assert float((value - truth)[clear].norm()) <= 0.01 * float(truth[clear].norm()), plane
    assert all(bool(torch.isfinite(g).all()) for g in gradients.values())


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
    view = straight(*size)
    out = render(surfels, view, ("alpha",))
    truth = render_reference(surfels, view, 1, near=0.2, far=100.0)
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
