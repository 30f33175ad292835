"""The splat PLY as plyfile and Unveil itself read it."""

from __future__ import annotations

import json

import numpy as np
import torch
from plyfile import PlyData

from tests.exports.conftest import Street
from tests.exports.street import CAR, ROAD, SEEDS, WORLD
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.raster import render
from unveil_core.surfels.ply import read_surfels


def test_attributes_are_those_of_the_field_in_the_drives_coordinates(street: Street) -> None:
    path, job = street.exported("splat-ply"), street.job
    data = PlyData.read(str(path))
    vertex, scene = data["vertex"], job.scene
    assert len(vertex.data) == len(scene)
    assert [p.name for p in vertex.properties] == [
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(24))),
        *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "label", "instance"),
    ]
    told = json.loads(path.with_name(path.name + ".json").read_text())
    assert f"shift {' '.join(repr(v) for v in told['shift'])}" in data.comments
    positions = np.stack([vertex[n] for n in "xyz"], axis=1) + np.array(told["shift"])
    np.testing.assert_allclose(positions, WORLD.to_world(scene.means.double().numpy()), atol=1e-5)
    assert np.abs(positions).max() > 6e6 > 1e4 > np.abs(np.array(vertex["x"])).max()
    scales = np.stack([vertex[f"scale_{k}"] for k in range(3)], axis=1)
    np.testing.assert_allclose(scales[:, :2], scene.log_scales + np.log(WORLD.scale), atol=1e-5)
    np.testing.assert_allclose(np.exp(scales[:, 2]), 1e-4 * WORLD.scale, rtol=1e-5)
    np.testing.assert_allclose(vertex["opacity"], scene.opacity_logits, atol=1e-6)
    np.testing.assert_allclose(np.stack([vertex[f"f_dc_{k}"] for k in range(3)], 1), scene.sh[:, 0], atol=1e-6)
    assert set(np.unique(vertex["label"])) == {ROAD, CAR}
    assert np.array_equal(vertex["instance"] > 0, np.array(vertex["label"]) == CAR)  # the car that stays
    assert set(np.unique(vertex["instance"])) == {0, 3} and not vertex["instance"][-SEEDS:].any()


def test_unveil_renders_the_same_of_it(street: Street) -> None:
    scene, job = read_surfels(street.exported("splat-ply")), street.job
    place = drive_coordinates(job.drive).shifted
    for frame in job.drive.frames:
        with torch.no_grad():
            ours = render(job.scene, frame.camera, ("rgb",), near=NEAR_M, far=FAR_M).rgb
            camera = place.camera_to_world(frame.camera)
            theirs = render(scene, camera, ("rgb",), near=NEAR_M * place.scale, far=FAR_M * place.scale).rgb
        assert ours is not None and theirs is not None and float(ours.max()) > 0.3
        assert (
            -10 * np.log10(float((ours - theirs).square().mean()) + 1e-12) > 50
        )  # dB: 0.1 dB of any score is far away
