"""Drives of several cameras on one car: one path, one ground and one scene for all of them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.small_rig import FRONT, LEFT, RIGHT, make_small_rig
from unveil_core.base.files import read_json
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.ground.files import read_ground
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

PLACES = np.arange(0.0, 13.0, 1.5)
SETTINGS = RunSettings(quality="draft", iterations=60, splats=6000, remove=("car",))
DARK = 0.8
CAMERAS = [replace(LEFT, gain=(DARK,) * 3), replace(RIGHT, every=2, late=0.03), FRONT]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("alone")
    return run(make_small_rig(folder / "street", [FRONT], PLACES), folder / "ws", SETTINGS, until="remove")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("rig")
    return run(make_small_rig(folder / "street", CAMERAS, PLACES), folder / "ws", SETTINGS, until="deliver")


def drive_of(workspace: Workspace) -> Drive:
    return read_imported(workspace.drive_dir)


def masks(workspace: Workspace, kind: str, camera: str) -> list[np.ndarray]:
    return [read_label_image(p) > 0 for p in sorted((workspace.root / "masks" / kind / camera).glob("*.png"))]


def test_side_cameras_do_not_bend_the_path_nor_the_ground(alone: Workspace, rig: Workspace) -> None:
    places, heights = [], []
    for workspace in (alone, rig):
        to_world, ground = drive_of(workspace).to_world, read_ground(workspace.ground_npz)
        street = np.stack([p.ravel() for p in np.meshgrid(np.arange(0.0, 25.0), (-3.0, 0.0, 3.0))], axis=1)
        places.append(to_world.to_world(ground.path.to_world(np.c_[street, 0 * street[:, 0]]))[:, :2])
        assert ground.street is not None
        heights.append(ground.street.height_at(*street.T) + to_world.translation[2])
    assert np.abs(places[0] - places[1]).max() < 0.03
    assert max(np.abs(h).max() for h in heights) < 0.05
    assert read_json(rig.root / "ground/ground.json")["track"] == "front"


def test_what_a_side_camera_saw_fills_the_front_cameras_hole(alone: Workspace, rig: Workspace) -> None:
    before, now = (masks(w, "unobserved", "front") for w in (alone, rig))
    assert sum(map(np.sum, now)) < 0.8 * sum(map(np.sum, before))
    errors = []
    for i, (old, new) in enumerate(zip(before, now, strict=True)):
        delivered = read_image(rig.root / f"frames/front/{i:03d}.png").astype(int)
        true = cv2.cvtColor(FRONT.picture(PLACES[i], crowded=False)[0], cv2.COLOR_BGR2RGB)
        errors.append(np.abs(delivered - true)[old & ~new].ravel())
    assert np.concatenate(errors).mean() < 20


def test_a_camera_of_other_colours_shows_the_same_street(rig: Workspace) -> None:
    """The scene has one colour for a place, each photograph its own, and every camera is delivered as it photographs."""
    exposures = read_exposures(rig.exposure_json)
    grey = {f.camera_name: 0.5 * exposures.of(f).gain + exposures.of(f).bias for f in drive_of(rig).frames}
    assert np.abs(grey["left"] / grey["front"] / DARK - 1).max() < 0.05
    assert np.abs(grey["right"] / grey["front"] - 1).max() < 0.05
    for camera in CAMERAS:
        files = sorted((rig.root / "frames" / camera.name).iterdir())
        assert [p.stem for p in files] == [f"{i:03d}" for i in range(0, len(PLACES), camera.every)]
        for file, removed, shadow in zip(
            files, masks(rig, "removed", camera.name), masks(rig, "shadows", camera.name), strict=True
        ):
            photograph = cv2.cvtColor(camera.picture(PLACES[int(file.stem)])[0], cv2.COLOR_BGR2RGB)
            delivered = read_image(file)
            assert delivered.shape[1::-1] == camera.size
            assert (delivered == photograph)[~(removed | shadow)].all()
    gone = [m.sum() for m in masks(rig, "removed", "right")]
    assert sum(gone) > 300


def test_renders_of_every_camera_are_like_its_photographs(rig: Workspace) -> None:
    for camera in CAMERAS:
        errors = []
        for file, removed in zip(
            sorted((rig.root / "renders" / camera.name).iterdir()), masks(rig, "removed", camera.name), strict=True
        ):
            photograph = cv2.cvtColor(camera.picture(PLACES[int(file.stem)])[0], cv2.COLOR_BGR2RGB).astype(int)
            errors.append(((read_image(file) - photograph) ** 2)[~removed].ravel())
        assert 10 * np.log10(255**2 / np.concatenate(errors).mean()) > 25, camera.name
