"""Scenes as gsplat takes them: activated values, and pixels whose centres lie at integer + 0.5."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.raster.scenes import random_surfels
from unveil_core.base.errors import SettingsError
from unveil_core.geometry.camera import Camera
from unveil_core.raster import render
from unveil_core.surfels.surfels import THIN_LOG_SCALE, Surfels, rotations


def test_attributes_are_activated_and_come_back() -> None:
    scene = random_surfels(20, 0, degree=2)
    scene.quats[0] = 0
    given = scene.as_gsplat()
    shapes = {name: tuple(values.shape) for name, values in given.items() if isinstance(values, torch.Tensor)}
    assert shapes == {"means": (20, 3), "quats": (20, 4), "scales": (20, 3), "opacities": (20,), "colors": (20, 9, 3)}
    assert given["sh_degree"] == 2
    torch.testing.assert_close(given["quats"].norm(dim=1), torch.ones(20))
    torch.testing.assert_close(given["scales"][:, :2], scene.log_scales.exp())
    torch.testing.assert_close(given["scales"][:, 2].log(), torch.full((20,), THIN_LOG_SCALE))
    torch.testing.assert_close(given["opacities"], 1 / (1 + (-scene.opacity_logits).exp()))
    back = Surfels.from_gsplat(**given, labels=scene.labels)
    torch.testing.assert_close(rotations(back.quats), rotations(scene.quats))
    for name in ("means", "log_scales", "opacity_logits", "sh", "labels"):
        torch.testing.assert_close(getattr(back, name), getattr(scene, name), rtol=1e-5, atol=1e-5)


def test_a_lower_degree_leaves_coefficients_out_and_opaque_ones_stay_finite() -> None:
    given = random_surfels(5, 1, degree=2).as_gsplat()
    given.update(sh_degree=1, opacities=torch.ones(5))
    back = Surfels.from_gsplat(**given)
    assert back.sh_degree == 1 and not back.labels.any()
    assert torch.isfinite(back.opacity_logits).all() and (back.opacity_logits.sigmoid() > 0.999).all()


def test_gradients_flow_to_the_parameters() -> None:
    scene = random_surfels(4, 2)
    scene = replace(scene, opacity_logits=scene.opacity_logits.requires_grad_())
    scene.as_gsplat()["opacities"].sum().backward()
    assert scene.opacity_logits.grad is not None and (scene.opacity_logits.grad > 0).all()


@pytest.mark.parametrize(
    ("name", "shape"), [("quats", (5, 3)), ("scales", (5, 4)), ("opacities", (5, 1)), ("colors", (5, 1, 3))]
)
def test_other_shapes_are_refused_by_name(name: str, shape: tuple[int, ...]) -> None:
    given = {**random_surfels(5, 3, degree=1).as_gsplat(), name: torch.ones(shape)}
    with pytest.raises(SettingsError, match=f"Not the shape of 5 2D Gaussians: {name} "):
        Surfels.from_gsplat(**given)  # type: ignore[arg-type]


def test_a_gaussian_is_drawn_where_gsplat_projects_it() -> None:
    """Its centre by K and viewmat is the centre of the blob, counted with pixel centres at + 0.5: not half a pixel beside it."""
    facing = Rotation.from_euler("xyz", (0.4, -0.7, 1.1))  # from the camera's axes to the world's
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = facing.inv().as_matrix(), (0.3, -0.2, 0.4)
    camera = Camera(64, 48, 70.0, 66.0, 29.3, 25.8, pose)
    place = camera.centre + 5.0 * camera.rays_at(np.array([[40.2, 20.7]]))[0]
    scene = Surfels(
        torch.tensor(place[None], dtype=torch.float32),
        torch.tensor(np.roll(facing.as_quat(), 1)[None], dtype=torch.float32),
        torch.full((1, 2), float(np.log(0.15))),
        torch.tensor([2.0]),
        torch.zeros(1, 1, 3),
        torch.zeros(1, dtype=torch.int64),
    )
    given = scene.as_gsplat()
    local = camera.viewmat @ [*given["means"][0].double().numpy(), 1.0]
    pixel = camera.K @ local[:3] / local[2]
    alpha = render(Surfels.from_gsplat(**given), camera, ("alpha",)).alpha
    assert alpha is not None
    weight = alpha.double().numpy()
    rows, columns = np.indices(weight.shape) + 0.5
    blob = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
    assert weight.max() > 0.5 and np.abs(blob - pixel[:2]).max() < 0.02
