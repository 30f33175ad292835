"""Starting surfels; the sky."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from unveil_core.geometry.axes import up_frame
from unveil_core.geometry.camera import Camera
from unveil_core.surfels.initialize import SH_C0, surfels_from_points
from unveil_core.surfels.sky import Sky, fit_sky


def test_colour_comes_back() -> None:
    colors = np.array([[255, 0, 128], [10, 200, 30]], dtype=np.uint8)
    surfels = surfels_from_points(
        np.zeros((2, 3)), colors, np.array([1, 2]), np.array([[0, 0, 1.0]] * 2), np.ones(2), sh_degree=2
    )
    assert surfels.sh.shape == (2, 9, 3)
    assert np.abs((0.5 + SH_C0 * surfels.sh[:, 0].numpy()) * 255 - colors).max() < 1e-3
    assert surfels.sh_degree == 2


def camera_towards(azimuth: float, elevation: float = 0.2) -> Camera:
    forward = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    return Camera(60, 40, 50.0, 50.0, 30.0, 20.0, pose)


def gradient_sky(camera: Camera) -> np.ndarray:
    rays = camera.rays()
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.stack([0.5 + 0.3 * rays[..., 0], 0.5 + 0.3 * rays[..., 1], 0.6 + 0.2 * rays[..., 2]], axis=-1)


def test_sky_gives_back_what_it_saw_also_behind_the_seam() -> None:
    views = [camera_towards(a) for a in np.linspace(-np.pi, np.pi, 13)]
    samples = [(c, (gradient_sky(c) * 255).round().astype(np.uint8), np.ones((40, 60), bool)) for c in views]
    sky = fit_sky(samples, np.array([0.0, 0.0, 1.0]))
    for azimuth in (0.3, np.pi - 0.01, -np.pi + 0.3):
        camera = camera_towards(azimuth)
        assert np.abs(sky.render(camera).numpy() - gradient_sky(camera)).max() < 0.05


def test_sky_without_any_pixel_is_grey_and_finite() -> None:
    sky = fit_sky([], np.array([0.0, 0.0, 1.0]))
    assert torch.isfinite(sky.texture).all()


def test_sky_texture_gets_a_gradient() -> None:
    texture = torch.rand(3, 8, 16, requires_grad=True)
    sky = Sky(texture.detach(), up_frame(np.array([0.0, 0.0, 1.0])))
    camera = camera_towards(0.4)
    sky.sample(sky.grid(camera), texture).sum().backward()
    assert texture.grad is not None and float(texture.grad.sum()) == pytest.approx(3 * 40 * 60, rel=1e-4)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (1, 0, 0), (0.3, 0.4, 0.5)])
def test_up_frame_is_a_rotation(up: tuple[float, float, float]) -> None:
    axes = up_frame(np.array(up, dtype=float))
    assert np.abs(axes @ axes.T - np.eye(3)).max() < 1e-12
    assert np.linalg.det(axes) > 0
    assert axes[2] @ np.array(up) > 0
