"""The splat PLY by the rules of Unity's importer, PlayCanvas, SuperSplat and the reference implementation; Unveil renders it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.exports.conftest import Street
from tests.exports.readers.splat_ply import Splats, read_as_playcanvas, read_as_reference, read_as_unity
from tests.exports.street import CAR, ROAD, SEEDS, WORLD
from tests.plain_ply import comments_of, read_plain_ply
from unveil_core.app.cli import main
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.splats.placed import placed
from unveil_core.raster import render
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.surfels import Surfels, with_sh_degree

READERS = (read_as_unity, read_as_playcanvas, read_as_reference)


def check(found: Splats, scene: Surfels) -> None:
    """A program found the splats that the scene has, each number at its place."""
    assert len(found.used) == len(scene)
    np.testing.assert_array_equal(np.stack([found.of(n) for n in "xyz"], 1), scene.means)
    np.testing.assert_array_equal(np.stack([found.of(f"f_dc_{k}") for k in range(3)], 1), scene.sh[:, 0])
    np.testing.assert_array_equal(found.of("opacity"), scene.opacity_logits)
    np.testing.assert_array_equal(np.stack([found.of(f"scale_{k}") for k in range(2)], 1), scene.log_scales[:, :2])
    np.testing.assert_array_equal(np.stack([found.of(f"rot_{k}") for k in range(4)], 1), scene.quats)
    np.testing.assert_array_equal(found.sh, with_sh_degree(scene, 3).sh[:, 1:])


@pytest.mark.parametrize("read", READERS)
def test_programs_find_each_splat(read: Callable[[Path], Splats], street: Street) -> None:
    job = street.job
    check(read(street.exported("splat-ply")), placed(job.scene, drive_coordinates(job.drive).shifted))


@pytest.mark.parametrize("read", READERS)
def test_programs_find_each_splat_of_a_removed_object(read: Callable[[Path], Splats], street: Street) -> None:
    job = street.job
    own = job.full.select(torch.from_numpy(np.flatnonzero(job.full_instances == 1)))
    check(read(street.exported("objects-json") / "car_0001.ply"), placed(own, drive_coordinates(job.drive).shifted))


@pytest.mark.parametrize("read", READERS[:2])
@pytest.mark.parametrize("degree", [0, 3])
def test_viewers_open_the_workspaces_own_scene(
    degree: int, read: Callable[[Path], Splats], street: Street, tmp_path: Path
) -> None:
    scene = with_sh_degree(street.job.scene, degree)
    write_surfels(scene, tmp_path / "surfels.ply", to_world=WORLD, comments=("labels road,car",))
    check(read(tmp_path / "surfels.ply"), scene)


@pytest.mark.parametrize(("degree", "coefficients"), [(0, 0), (1, 45), (2, 45), (3, 45)])
def test_a_scene_has_all_harmonics_or_none(degree: int, coefficients: int, street: Street, tmp_path: Path) -> None:
    root = tmp_path / "workspace"
    shutil.copytree(street.root, root)
    scene = with_sh_degree(street.job.scene, degree)
    write_surfels(scene, root / "surfels/empty.ply", to_world=WORLD)
    assert main(["export", str(root), "--to", "splat-ply", "-o", str(tmp_path)]) == 0
    path = tmp_path / "empty_splats.ply"
    names = read_plain_ply(path).dtype.names or ()
    assert sum(name.startswith("f_rest_") for name in names) == coefficients
    there = placed(scene, drive_coordinates(street.job.drive).shifted)
    for read in READERS if coefficients else READERS[:2]:
        check(read(path), there)


@pytest.mark.parametrize("kind", ["discs", "ellipsoids", "a removed object"])
def test_viewers_find_three_scales(kind: str, street: Street, tmp_path: Path) -> None:
    """Discs have two: the third is thin, a tenth of a millimetre in the drive's units."""
    path, thin = street.exported("splat-ply"), np.log(1e-4 * WORLD.scale)
    if kind == "a removed object":
        path = street.exported("objects-json") / "car_0002.ply"
    elif kind == "ellipsoids":
        root, thin = tmp_path / "workspace", np.log(0.02 * WORLD.scale)
        shutil.copytree(street.root, root)
        scene = street.job.scene
        third = torch.full((len(scene), 1), float(np.log(0.02)))
        solid = replace(scene, log_scales=torch.cat([scene.log_scales, third], dim=1))
        write_surfels(solid, root / "surfels/empty.ply", to_world=WORLD)
        assert main(["export", str(root), "--to", "splat-ply", "-o", str(tmp_path)]) == 0
        path = tmp_path / "empty_splats.ply"
    for read in READERS:
        found = read(path)
        np.testing.assert_allclose(found.of("scale_2"), thin, atol=1e-5)
        assert np.isfinite(found.of("scale_1")).all() and len(found.used) > 5


def test_attributes_are_those_of_the_field_in_the_drives_coordinates(street: Street) -> None:
    path, job = street.exported("splat-ply"), street.job
    vertex, scene = read_plain_ply(path), job.scene
    assert vertex.dtype.names == (
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(45))),
        *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "label", "instance"),
    )
    told = json.loads(path.with_name(path.name + ".json").read_text())
    assert f"shift {' '.join(repr(v) for v in told['shift'])}" in comments_of(path)
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


def test_another_library_reads_the_same(street: Street) -> None:
    gsply = pytest.importorskip("gsply")
    job = street.job
    there = placed(job.scene, drive_coordinates(job.drive).shifted)
    found = gsply.plyread(str(street.exported("splat-ply")))
    np.testing.assert_array_equal(found.means, there.means)
    np.testing.assert_array_equal(found.quats, there.quats)
    np.testing.assert_array_equal(found.shN, with_sh_degree(there, 3).sh[:, 1:])
