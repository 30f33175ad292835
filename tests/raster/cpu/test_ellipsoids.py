"""Surfels with three scales: against float64, against the textbook, against discs, and where they might break."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.raster.hard_cases import CASES, HardCase
from tests.raster.scenes import GRADIENTS, camera, random_ellipsoids, with_gradients
from tests.raster.test_gradients import compare
from tests.raster.test_hard_cases import assert_alike
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.passes import field_of_view
from unveil_core.raster.reference import render_reference, render_reference_in_tiles
from unveil_core.raster.spec import DILATION, Limits
from unveil_core.surfels.surfels import Surfels, rotations

LIMIT = 5e-6


def ahead(width: int = 64, height: int = 48) -> Camera:
    """A camera at the origin that looks along z."""
    return Camera(width, height, 50.0, 52.0, width / 2, height / 2, np.eye(4))


def one(
    mean: tuple[float, float, float],
    scales: tuple[float, ...],
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
    logit: float = 1.0,
) -> Surfels:
    return Surfels(
        torch.tensor([mean]),
        torch.tensor([quat]),
        torch.tensor([scales]).log(),
        torch.tensor([logit]),
        torch.zeros(1, 1, 3),
        torch.zeros(1, dtype=torch.int64),
    )


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("plane", PLANES)
def test_plane_and_gradients_match_float64(plane: str, seed: int) -> None:
    compare(random_ellipsoids(120, seed), plane, LIMIT, LIMIT)


@pytest.mark.parametrize("plane", ["rgb", "depth", "normal"])
def test_near_ones_and_ones_beyond_the_field_of_view_match_float64(plane: str) -> None:
    surfels = random_ellipsoids(150, 1, spread=2.2, grazing=True)
    surfels = replace(surfels, means=surfels.means * 0.5)
    local = surfels.means @ torch.from_numpy(camera().world_to_camera[:3, :3]).float().T
    assert float((local[:, 0].abs() / local[:, 2] > max(field_of_view(camera()))).float().mean()) > 0.2
    compare(surfels, plane, LIMIT, LIMIT)


@pytest.mark.parametrize("smaller", [6.0, 12.0])
def test_ones_far_smaller_than_a_pixel_keep_their_gradients(smaller: float) -> None:
    """Their footprint is the low-pass filter's circle to four digits, or to all: a tie that rounding must not decide."""
    surfels = random_ellipsoids(120, 2)
    compare(replace(surfels, log_scales=surfels.log_scales - smaller), "rgb", LIMIT, LIMIT)


def test_footprint_is_that_of_the_textbook() -> None:
    surfels, view = one((0.6, -0.4, 3.0), (0.5, 0.2, 0.05), (0.8, 0.3, -0.4, 0.2)), ahead()
    X, Y, Z = surfels.means[0].double().numpy()
    axes = rotations(surfels.quats)[0].double().numpy() * surfels.log_scales[0].exp().double().numpy()
    jacobian = np.array([[view.fx / Z, 0, -view.fx * X / Z**2], [0, view.fy / Z, -view.fy * Y / Z**2]])
    covariance = jacobian @ axes @ axes.T @ jacobian.T + DILATION * np.eye(2)
    ys, xs = np.mgrid[:48, :64] + 0.5
    d = np.stack([xs - view.cx - view.fx * X / Z, ys - view.cy - view.fy * Y / Z], axis=-1)
    expected = np.exp(-0.5 * np.einsum("hwi,ij,hwj->hw", d, np.linalg.inv(covariance), d)) / (1 + np.exp(-1.0))
    expected[expected < 1 / 255] = 0
    out = render(surfels, view, PLANES)
    assert out.alpha is not None and out.normal is not None and out.depth is not None
    np.testing.assert_allclose(out.alpha.numpy(), expected, atol=1e-6)
    np.testing.assert_allclose(out.depth.numpy(), Z * expected, atol=4e-6)
    # The third scale is the smallest; turned towards the camera.
    normal = axes[:, 2] / np.linalg.norm(axes[:, 2])
    normal *= -np.sign(normal @ (X, Y, Z))
    np.testing.assert_allclose(out.normal.numpy(), normal * expected[..., None], atol=1e-6)


def test_flat_one_seen_face_on_is_the_disc() -> None:
    """But for the dilation, a thousandth of this disc's variance of 400 square pixels."""
    disc, flat = one((0.0, 0.0, 5.0), (2.0, 1.9)), one((0.0, 0.0, 5.0), (2.0, 1.9, 1e-4))
    a, b = render(disc, ahead(), PLANES), render(flat, ahead(), PLANES)
    for plane in PLANES:
        torch.testing.assert_close(getattr(b, plane), getattr(a, plane), atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("third", [-12.0, 0.0])
@pytest.mark.parametrize("name", CASES)
def test_hard_case_of_discs_with_a_third_scale_keeps_its_stated_error(name: str, third: float) -> None:
    def thick(surfels: Surfels) -> Surfels:
        return replace(surfels, log_scales=torch.nn.functional.pad(surfels.log_scales, (0, 1), value=third))

    case = CASES[name]
    true = None if case.true_surfels is None else thick(case.true_surfels)
    assert_alike(replace(case, surfels=thick(case.surfels), true_surfels=true), (37, 21), "cpu")


HARD = {
    "needle": one((0.1, 0.2, 3.0), (1e8, 1e-9, 1e-9), (0.9, 0.1, 0.2, 0.3)),
    "needle towards the camera": one((0.1, 0.2, 3.0), (1e-9, 1e-9, 1e8)),
    "sheet": one((0.1, 0.2, 3.0), (1e6, 1e-6, 1e6), (0.9, 0.1, 0.2, 0.3)),
    "as large as it may be": one((0.1, 0.2, 0.21), (1e15, 1e15, 1e15)),
    "sphere": one((0.1, 0.2, 3.0), (0.3, 0.3, 0.3), (0.9, 0.1, 0.2, 0.3)),
    "micrometre": one((0.1, 0.2, 3.0), (1e-6, 1e-6, 1e-6)),
    "opacity 0": one((0.1, 0.2, 3.0), (0.3, 0.2, 0.1), logit=-200.0),
    "opacity 1": one((0.1, 0.2, 3.0), (0.3, 0.2, 0.1), logit=200.0),
    "no rotation": one((0.1, 0.2, 3.0), (0.3, 0.2, 0.1), (0.0, 0.0, 0.0, 0.0)),
    "behind the camera": one((0.1, 0.2, -3.0), (3.0, 3.0, 3.0)),
    "centre nearer than near": one((0.1, 0.2, 0.1), (3.0, 3.0, 3.0)),
    "far off the axis": one((300.0, -100.0, 1.0), (100.0, 30.0, 90.0), (0.9, 0.1, 0.2, 0.3)),
    "at the field's edge": one((2.0, 1.0, 1.0), (0.5, 0.3, 0.9), (0.9, 0.1, 0.2, 0.3)),
}


@pytest.mark.parametrize("name", HARD)
def test_hard_one_is_finite_and_matches_float64(name: str) -> None:
    # Thousands of pixels aside, float32 places a centre to a few ten-thousandths of a pixel.
    assert_alike(HardCase(HARD[name], limit=1e-4 if name == "far off the axis" else 2e-5), (37, 21), "cpu")


def test_surfel_off_the_image_has_no_gradient() -> None:
    leaves = with_gradients(HARD["behind the camera"])
    out = render(leaves, ahead())
    assert out.rgb is not None and not bool(out.visible.any())
    out.rgb.sum().backward()  # type: ignore[no-untyped-call]
    assert all(not bool(getattr(leaves, name).grad.any()) for name in GRADIENTS)
    assert not bool(out.screen_gradients().any())


def test_exact_reach_loses_no_pixel() -> None:
    surfels = random_ellipsoids(300, 3)
    surfels = replace(surfels, log_scales=surfels.log_scales + torch.tensor([1.0, -3.0, -1.0]))
    exact, whole = (render(surfels, camera(), ("rgb",), limits=Limits(exact_reach=e)).rgb for e in (True, False))
    assert exact is not None and whole is not None
    assert torch.equal(exact, whole)


def test_reference_in_tiles_is_the_reference() -> None:
    surfels, view = random_ellipsoids(60, 4, spread=1.5), camera()
    surfels = replace(surfels, log_scales=surfels.log_scales + 1.0)
    whole = render_reference(surfels, view, 5, near=0.2, far=100.0)
    tiles, _ = render_reference_in_tiles(surfels, view, 5, near=0.2, far=100.0)
    for plane in PLANES:
        torch.testing.assert_close(tiles[plane], whole[plane])


def test_normal_is_the_axis_of_the_smallest_scale_and_the_last_of_equals() -> None:
    scales = torch.tensor([[1.0, 2, 3], [2, 1, 3], [2, 3, 1], [1, 1, 2], [2, 1, 1], [1, 2, 1], [1, 1, 1]])
    surfels = random_ellipsoids(7, 0)
    surfels = replace(surfels, log_scales=scales)
    assert surfels.normal_axes().tolist() == [0, 1, 2, 1, 2, 2, 2]
    out = render(surfels.select(torch.tensor([3])), camera(), ("normal", "alpha"))
    assert out.normal is not None and out.alpha is not None
    seen = (out.normal / out.alpha[..., None])[16, 24]
    normal = surfels.normals()[3] @ torch.from_numpy(camera().world_to_camera[:3, :3]).float().T
    assert float(seen @ normal) == pytest.approx(-1.0, abs=1e-5) or float(seen @ normal) == pytest.approx(1.0, abs=1e-5)
