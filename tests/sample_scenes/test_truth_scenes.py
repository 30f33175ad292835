"""The truth scenes hold together: what they say of themselves is what their files show."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.blender_addon.run_in_blender import BLENDER, WITH_OTHERS
from unveil_core.drives import open_drive
from unveil_core.drives.camera_path import read_camera_path
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.semantics.classes import CITYSCAPES

SCENES = Path(__file__).resolve().parents[2] / "sample_scenes"
GENERATORS = SCENES / "generators"
CARS, PEOPLE, STEP = {"parked_street": 9, "country_road": 5}, {"parked_street": 2, "country_road": 1}, (0.8, 2.0)
FEWEST_ROAD = {"parked_street": 500, "country_road": 150}


@pytest.fixture(params=CARS, scope="module")
def folder(request: pytest.FixtureRequest) -> Path:
    return SCENES / str(request.param)


def test_it_is_a_good_drive_with_large_coordinates(folder: Path) -> None:
    drive = open_drive(folder)
    check_drive(drive)
    assert 24 <= len(drive.frames) <= 32 and drive.scale_source == "metric" and drive.truth_root is not None
    assert np.abs(drive.frames[0].camera.centre).max() > 1e5
    centres = np.stack([f.camera.centre for f in drive.frames])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert (steps > STEP[0]).all() and (steps < STEP[1]).all()


def test_it_is_small(folder: Path) -> None:
    assert sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) < 8e6


def test_cars_and_people_are_as_listed(folder: Path) -> None:
    drive = open_drive(folder)
    listed = {i["id"]: i["class"] for i in json.loads((folder / "transforms.json").read_text())["instances"]}
    counts = [sum(c == name for c in listed.values()) for name in ("car", "person")]
    assert counts == [CARS[folder.name], PEOPLE[folder.name]]
    seen: dict[int, int] = {}
    for frame in drive.frames:
        assert frame.semantic_path is not None and frame.instance_path is not None
        labels, ids = read_label_image(frame.semantic_path), read_instance_image(frame.instance_path)
        for i in np.unique(ids[ids > 0]):
            name = CITYSCAPES[int(np.bincount(labels[ids == i]).argmax())]
            assert name == listed[int(i)]
            seen[int(i)] = seen.get(int(i), 0) + 1
        removed = cv2.imread(str(folder / f"truth/removed/{frame.name}.png"), 0) > 0
        assert np.array_equal(removed, ids > 0)
    assert set(seen) == set(listed) and min(seen.values()) >= 3


def test_truth_differs_only_where_something_went(folder: Path) -> None:
    drive = open_drive(folder)
    for frame in drive.frames[::9]:
        full = read_image(frame.image_path).astype(float)
        empty = read_image(folder / f"truth/images/{frame.name}.jpg").astype(float)
        gone = cv2.imread(str(folder / f"truth/removed/{frame.name}.png"), 0) > 0
        gone |= cv2.imread(str(folder / f"truth/shadow/{frame.name}.png"), 0) > 0
        unseen = cv2.imread(str(folder / f"truth/unseen/{frame.name}.png"), 0) > 0
        assert not (unseen & ~gone).any()
        far = cv2.dilate(gone.astype(np.uint8), np.ones((13, 13), np.uint8)) == 0
        assert np.abs(full - empty)[far].mean() < 2.5
        assert np.abs(full - empty)[gone].mean() > 15


def test_points_fall_on_what_they_hit(folder: Path) -> None:
    drive = localized(open_drive(folder))
    frame = drive.frames[10]
    assert frame.semantic_path is not None
    depth = read_instance_image(folder / f"truth/depth/{frame.name}.png").astype(np.float64) / 256
    pixel, z = frame.camera.project(drive.points.positions)
    inside = (z > 2) & (z < 25) & (pixel >= 1).all(axis=1) & (pixel[:, 0] < 383) & (pixel[:, 1] < 255)
    column, row = pixel[inside, 0].astype(int), pixel[inside, 1].astype(int)
    labels = read_label_image(frame.semantic_path)[row, column]
    true = depth[row // 2, column // 2]
    road = (labels == 0) & (np.abs(true - z[inside]) < 0.5)
    assert road.sum() > FEWEST_ROAD[folder.name]
    assert np.median(np.abs(true - z[inside])[road]) < 0.15
    assert (labels[z[inside] < 0.9 * np.where(true > 0, true, 1e9)] != 10).mean() > 0.98  # none in the sky


def test_free_views_stand_beside_and_above_the_path(folder: Path) -> None:
    drive = localized(open_drive(folder))
    views = read_camera_path(folder / "truth/free/transforms.json", drive)
    frames = {f.name: f.camera for f in drive.frames}
    assert [v.track for v in views].count("beside") == [v.track for v in views].count("above") == 7
    sides = []
    for view in views:
        own = frames[view.name.split("_")[0]]
        x, y, z = own.world_to_camera[:3, :3] @ (view.camera.centre - own.centre)
        assert np.linalg.norm((x, y, z)) == pytest.approx(1.5 if view.track == "beside" else 1.0, abs=1e-6)
        np.testing.assert_allclose(view.camera.world_to_camera[:3, :3], own.world_to_camera[:3, :3], atol=1e-9)
        assert (view.camera.width, view.camera.fx) == (own.width, pytest.approx(own.fx))
        if view.track == "beside":
            assert abs(y) < 1e-6 and abs(z) < 1e-6
            sides.append(np.sign(x))
        else:
            assert (view.camera.centre - own.centre)[2] == pytest.approx(1.0, abs=1e-6)
    assert {*sides} == {-1.0, 1.0}
    assert sum(p.stat().st_size for p in (folder / "truth/free").rglob("*") if p.is_file()) < 1e6


def test_free_views_show_the_street_of_the_truth(folder: Path) -> None:
    """What stands where, by the recorded truth's depth, has the same colour in the free picture."""
    drive = localized(open_drive(folder))
    off = []
    for view in read_camera_path(folder / "truth/free/transforms.json", drive):
        picture = read_image(folder / f"truth/free/images/{view.name}.jpg").astype(float)
        removed = read_label_image(folder / f"truth/free/removed/{view.name}.png") > 0
        unseen = read_label_image(folder / f"truth/free/unseen/{view.name}.png") > 0
        assert not (unseen & ~removed).any()
        name = view.name.split("_")[0]
        frame = next(f for f in drive.frames if f.name == name)
        street = read_image(folder / f"truth/images/{name}.jpg").astype(float)[1::2, 1::2]
        depth = read_instance_image(folder / f"truth/depth/{name}.png") / 256.0
        near = (depth > 4) & (depth < 12)
        places = (frame.camera.centre + depth[..., None] * frame.camera.rays()[1::2, 1::2])[near]
        pixel, z = view.camera.project(places)
        inside = (z > 1) & (pixel >= 1).all(axis=1) & (pixel < (383, 255)).all(axis=1)
        column, row = pixel[inside, 0].astype(int), pixel[inside, 1].astype(int)
        off.append(np.abs(picture[row, column] - street[near][inside]).mean(axis=1))
    assert np.median(np.concatenate(off)) < 6


@pytest.mark.skipif(not BLENDER.is_file(), reason="Blender's Python module is an extra")
@pytest.mark.parametrize(("scene", "script", "everything"), [("parked_street", "build_street", 300), ("country_road", "build_road", 120)])
def test_the_script_builds_the_scene(scene: str, script: str, everything: int) -> None:
    code = (
        f"{WITH_OTHERS}sys.path.insert(0, sys.argv[1]); import {script} as b; s = b.build(7); "
        "import build_street as street; r = street.removable(s); "
        "print(len(r), sum(o['class'] == street.PERSON for o in r), len(s.objects))"
    )
    out = subprocess.run([str(BLENDER), "-c", code, str(GENERATORS / scene)], capture_output=True, text=True, timeout=120)
    assert out.returncode == 0, out.stderr[-500:]
    objects, people, built = (int(v) for v in out.stdout.split()[-3:])
    assert (objects, people) == (CARS[scene] + PEOPLE[scene], PEOPLE[scene]) and built > everything


def test_what_no_frame_shows_is_holes_not_specks(folder: Path) -> None:
    masks = [cv2.imread(str(p), 0) for p in sorted((folder / "truth/unseen").glob("*.png"))]
    areas = np.concatenate([cv2.connectedComponentsWithStats(mask, connectivity=8)[2][1:, cv2.CC_STAT_AREA] for mask in masks])
    assert areas[areas < 5].sum() < 0.03 * areas.sum()


def test_a_place_is_shown_by_the_pixel_that_shows_its_surface() -> None:
    visibility = _visibility()
    pose = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 1.6], [0, 0, 0, 1]])  # looks along y, z is up
    down = visibility.rays(pose)[..., 2] < -1e-3
    depth = np.where(down, -1.6 / np.minimum(visibility.rays(pose)[..., 2], -1e-3), np.inf)
    normal = np.zeros((*depth.shape, 3)) + (0, 0, 1)
    # The drive stands between the view's pixels: no place falls on the centre of one.
    other = pose.copy()
    other[:3, 3] += (0.31, 0.17, 0.0)
    asked = down & (depth < 30)
    asked[:, :40] = asked[:, -40:] = asked[-20:] = False
    free = np.zeros_like(asked)
    crowd = visibility.Crowd([other], [depth], [free])
    assert not visibility.never_seen(pose, asked, depth, normal, crowd).any()
    # A place half a metre under the ground is not shown, nor one where an object stands at the ground's own depth.
    sunk = np.where(down, depth * 1.3, np.inf)
    assert visibility.never_seen(pose, asked, sunk, normal, crowd).sum() > 0.95 * asked.sum()
    taken = visibility.Crowd([other], [depth], [~free])
    assert np.array_equal(visibility.never_seen(pose, asked, depth, normal, taken), asked)


def _visibility():  # type: ignore[no-untyped-def]
    path = GENERATORS / "parked_street/visibility.py"
    spec = importlib.util.spec_from_file_location("visibility", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
