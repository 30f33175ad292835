"""Splats in other coordinates look the same to a camera that is moved likewise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exports.conftest import Street
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.exports.splats.placed import placed, turned_sh
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import quat_to_rotation
from unveil_core.raster import render
from unveil_core.raster.spherical_harmonics import evaluate

QUATS = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)


@settings(max_examples=20)
@given(quat=QUATS, degree=st.integers(0, 3), seed=st.integers(0, 999))
def test_turned_colours_are_those_of_the_direction_before(quat: list[float], degree: int, seed: int) -> None:
    rotation = quat_to_rotation(quat)
    rng = np.random.default_rng(seed)
    sh = torch.from_numpy(rng.normal(0, 0.1, (5, (degree + 1) ** 2, 3)))
    before = rng.normal(size=(5, 3))
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    after = evaluate(turned_sh(sh, rotation), torch.from_numpy(before @ rotation.T))
    np.testing.assert_allclose(after, evaluate(sh, torch.from_numpy(before)), atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 0.1, 3.0])
def test_a_moved_camera_sees_the_same_picture(street: Street, scale: float) -> None:
    job = street.job
    place = Similarity(scale, quat_to_rotation([0.6, -0.3, 0.5, 0.2]), np.array([30.0, -7.0, 4.0]))
    camera = job.drive.frames[0].camera
    moved = place.camera_to_world(camera)
    there = placed(job.scene, place)
    with torch.no_grad():
        before = render(job.scene, camera, ("rgb",), near=NEAR_M, far=FAR_M).rgb
        after = render(there, moved, ("rgb",), near=NEAR_M * scale, far=FAR_M * scale).rgb
        plain = replace(there, sh=job.scene.sh)
        unturned = render(plain, moved, ("rgb",), near=NEAR_M * scale, far=FAR_M * scale).rgb
    assert before is not None and after is not None and unturned is not None
    assert float(before.max()) > 0.3
    np.testing.assert_allclose(after, before, atol=2e-3)
    assert float((unturned - before).abs().max()) > 0.02  # colours by direction matter in this scene
