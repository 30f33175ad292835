"""The sample drive holds together: what it says of itself is what its files show."""

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

FOLDER = Path(__file__).resolve().parents[2] / "sample_scenes" / "parked_street"


def test_it_is_a_good_drive_with_large_coordinates() -> None:
    drive = open_drive(FOLDER)
    check_drive(drive)
    assert 24 <= len(drive.frames) <= 32 and drive.metric and drive.truth_root is not None
    assert np.abs(drive.frames[0].camera.centre).max() > 1e5
    centres = np.stack([f.camera.centre for f in drive.frames])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert (steps > 0.8).all() and (steps < 1.6).all()


def test_it_is_small() -> None:
    assert sum(p.stat().st_size for p in FOLDER.rglob("*") if p.is_file()) < 8e6


def test_cars_and_people_are_as_listed() -> None:
    drive = open_drive(FOLDER)
    listed = {i["id"]: i["class"] for i in json.loads((FOLDER / "transforms.json").read_text())["instances"]}
    assert sum(c == "car" for c in listed.values()) >= 7 and sum(c == "person" for c in listed.values()) == 2
    seen: dict[int, int] = {}
    for frame in drive.frames:
        assert frame.semantic_path is not None and frame.instance_path is not None
        labels, ids = read_label_image(frame.semantic_path), read_instance_image(frame.instance_path)
        for i in np.unique(ids[ids > 0]):
            name = CITYSCAPES[int(np.bincount(labels[ids == i]).argmax())]
            assert name == listed[int(i)]
            seen[int(i)] = seen.get(int(i), 0) + 1
        removed = cv2.imread(str(FOLDER / f"truth/removed/{frame.name}.png"), 0) > 0
        assert np.array_equal(removed, ids > 0)
    assert set(seen) == set(listed) and min(seen.values()) >= 3


def test_truth_differs_only_where_something_went() -> None:
    drive = open_drive(FOLDER)
    for frame in drive.frames[::9]:
        full = read_image(frame.image_path).astype(float)
        empty = read_image(FOLDER / f"truth/images/{frame.name}.jpg").astype(float)
        gone = cv2.imread(str(FOLDER / f"truth/removed/{frame.name}.png"), 0) > 0
        gone |= cv2.imread(str(FOLDER / f"truth/shadow/{frame.name}.png"), 0) > 0
        unseen = cv2.imread(str(FOLDER / f"truth/unseen/{frame.name}.png"), 0) > 0
        assert not (unseen & ~gone).any()
        far = cv2.dilate(gone.astype(np.uint8), np.ones((13, 13), np.uint8)) == 0
        assert np.abs(full - empty)[far].mean() < 2.5
        assert np.abs(full - empty)[gone].mean() > 15


def test_points_fall_on_what_they_hit() -> None:
    drive = recentred(open_drive(FOLDER))
    frame = drive.frames[10]
    assert frame.semantic_path is not None
    depth = np.load(FOLDER / f"truth/depth/{frame.name}.npy").astype(np.float64)
    pixel, z = frame.camera.project(drive.points.positions)
    inside = (z > 2) & (z < 25) & (pixel >= 1).all(axis=1) & (pixel[:, 0] < 383) & (pixel[:, 1] < 255)
    column, row = pixel[inside, 0].astype(int), pixel[inside, 1].astype(int)
    labels = read_label_image(frame.semantic_path)[row, column]
    true = depth[row // 2, column // 2]
    road = (labels == 0) & (np.abs(true - z[inside]) < 0.5)
    assert road.sum() > 500
    assert np.median(np.abs(true - z[inside])[road]) < 0.15
    assert (labels[z[inside] < 0.9 * np.where(np.isfinite(true), true, 1e9)] != 10).mean() > 0.98  # none in the sky


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="Blender's Python module is an extra")
def test_the_script_builds_the_street() -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import build_street as b; s = b.build(7); "
        "r = b.removable(s); print(len(r), sum(o['class'] == b.PERSON for o in r), len(s.objects))"
    )
    out = subprocess.run([sys.executable, "-c", code, str(FOLDER)], capture_output=True, text=True, timeout=120)
    assert out.returncode == 0, out.stderr[-500:]
    objects, people, everything = (int(v) for v in out.stdout.split()[-3:])
    assert (objects, people) == (11, 2) and everything > 300
