"""The ground of the true street, by its semantics, its depth, or the drive's labels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.mesh.street import HALF_WIDTH, cast, street_camera
from unveil_core.base.files import write_image_atomic
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.detail.ground_pixels import faces_up, ground_pixels
from unveil_core.evaluate.flicker import DepthGrid
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow

CAMERA = street_camera(0.0, 384, 256)


def is_ground(camera: Camera = CAMERA) -> np.ndarray:
    street = cast(camera)
    points = camera.unproject(street["depth"])
    return (street["depth"] > 0) & (points[..., 2] < 0.01) & (np.abs(points[..., 1]) < HALF_WIDTH)


def frame(tmp_path: Path, **files: Path) -> Frame:
    return replace(Frame("0000", "front", CAMERA, tmp_path / "0000.png"), **files)


def removed() -> np.ndarray:
    mask = np.zeros((256, 384), dtype=bool)
    mask[140:200, 20:140] = True
    return mask


def check(found: np.ndarray | None, rim: int = 4) -> None:
    """All ground is found but its rim, and nothing else."""
    assert found is not None
    true = is_ground()
    assert not (found & ~true).any()
    inner = ~grow(~true, rim)
    assert found[inner].mean() > 0.99


@pytest.mark.parametrize("step", [1, 2])
def test_by_depth(tmp_path: Path, step: int) -> None:
    depth = cast(CAMERA)["depth"][step - 1 :: step, step - 1 :: step]
    write_image_atomic(tmp_path / "depth/0000.png", np.round(depth * 256).astype(np.uint16))
    check(ground_pixels(tmp_path, frame(tmp_path), removed()), 5)


def test_walls_and_sky_do_not_face_up() -> None:
    depth = cast(CAMERA)["depth"].astype(np.float64)
    assert not faces_up(DepthGrid(CAMERA, np.zeros_like(depth))).any()
    wall = np.full_like(depth, 5.0)
    assert not faces_up(DepthGrid(CAMERA, wall)).any()


def test_by_the_truths_semantics_first(tmp_path: Path) -> None:
    labels = np.where(is_ground(), 0, 2).astype(np.uint8)
    write_image_atomic(tmp_path / "semantics/0000.png", labels)
    write_image_atomic(tmp_path / "depth/0000.png", np.zeros((256, 384), dtype=np.uint16))
    check(ground_pixels(tmp_path, frame(tmp_path), removed()))


def test_by_the_drives_labels_continued(tmp_path: Path) -> None:
    """The car's label reaches a little farther than what is removed; neither tells of the street."""
    labels = np.where(is_ground(), 0, 2).astype(np.uint8)
    labels[grow(removed(), 2)] = 13
    path = tmp_path / "labels.png"
    write_image_atomic(path, labels)
    found = ground_pixels(tmp_path, frame(tmp_path, semantic_path=path), removed())
    assert found is not None
    true = is_ground()
    assert not (found & ~true & ~removed()).any()
    assert (found == true)[removed()].mean() > 0.75  # the upper part takes the label of the facade above it


def test_unknown(tmp_path: Path) -> None:
    assert ground_pixels(tmp_path, frame(tmp_path), removed()) is None
