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

from unveil_core.drives import open_drive
from unveil_core.drives.check import check_drive
from unveil_core.drives.importing import recentred
from unveil_core.files import read_image, read_instance_image, read_label_image
from unveil_core.semantics.classes import CITYSCAPES

SCENES = Path(__file__).resolve().parents[2] / "sample_scenes"
CARS, PEOPLE, STEP = {"parked_street": 9, "country_road": 5}, {"parked_street": 2, "country_road": 1}, (0.8, 2.0)
FEWEST_ROAD = {"parked_street": 500, "country_road": 150}


@pytest.fixture(params=CARS, scope="module")
def folder(request: pytest.FixtureRequest) -> Path:
    return SCENES / str(request.param)


def test_it_is_a_good_drive_with_large_coordinates(folder: Path) -> None:
    drive = open_drive(folder)
    check_drive(drive)
    assert 24 <= len(drive.frames) <= 32 and drive.metric and drive.truth_root is not None
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
    drive = recentred(open_drive(folder))
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


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="Blender's Python module is an extra")
@pytest.mark.parametrize(("scene", "script", "everything"), [("parked_street", "build_street", 300), ("country_road", "build_road", 120)])
def test_the_script_builds_the_scene(scene: str, script: str, everything: int) -> None:
    code = (
        f"import sys; sys.path.insert(0, sys.argv[1]); import {script} as b; s = b.build(7); "
        "import build_street as street; r = street.removable(s); "
        "print(len(r), sum(o['class'] == street.PERSON for o in r), len(s.objects))"
    )
    out = subprocess.run([sys.executable, "-c", code, str(SCENES / scene)], capture_output=True, text=True, timeout=120)
    assert out.returncode == 0, out.stderr[-500:]
    objects, people, built = (int(v) for v in out.stdout.split()[-3:])
    assert (objects, people) == (CARS[scene] + PEOPLE[scene], PEOPLE[scene]) and built > everything
