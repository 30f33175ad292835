"""Footage in its lens beside the working picture without: positions, and the ST maps for compositing."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from scipy.ndimage import map_coordinates

from tests.ground.test_street import look
from unveil_core.delivery.lens import footage_positions, work_positions, write_st_maps
from unveil_core.drives.drive import Distortion, Footage
from unveil_core.drives.importing.frames import at_work_size, working_camera
from unveil_core.geometry.camera import Camera

LENSES = {
    "opencv": Distortion("OPENCV", (-0.12, 0.03, 0.001, -0.0015, 0.0, 0.0, 0.0, 0.0)),
    "fisheye": Distortion("OPENCV_FISHEYE", (0.02, -0.005, 0.001, 0.0)),
}


def footage_of(lens: str) -> Footage:
    pose = look(np.array([1.0, 2.0, 1.6]), 0.4).world_to_camera
    return Footage(Path("f.png"), Camera(240, 150, 190.0, 192.0, 123.5, 71.0, pose), LENSES[lens])


def picture() -> np.ndarray:
    """(150, 240, 3) uint8, smooth: reading between pixels is then exact to a level."""
    noise = np.random.default_rng(0).integers(0, 256, (150, 240, 3)).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), 6)
    return ((soft - soft.min()) / np.ptp(soft) * 255).astype(np.uint8)


def st_map(path: Path) -> np.ndarray:
    """(H, W, 2) of an ST map as a compositor reads it: where to read, pixels from the upper left corner."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        red, green = channels["R"].pixels, channels["G"].pixels
    assert red.dtype == green.dtype == np.float32
    height, width = red.shape
    return np.stack([red * width, (1 - green) * height], axis=-1)


def read_at(plane: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Of a plane (H, W…) at positions (…, 2); cv2.remap would round these to 1/32 pixel."""
    at = positions[..., ::-1].astype(np.float64) - 0.5
    planes = plane[..., None] if plane.ndim == 2 else plane
    read = [map_coordinates(p, np.moveaxis(at, -1, 0), order=1) for p in np.moveaxis(planes.astype(np.float64), -1, 0)]
    return read[0] if plane.ndim == 2 else np.stack(read, axis=-1)


def inner(plane: np.ndarray, margin: int = 12) -> np.ndarray:
    return plane[margin:-margin, margin:-margin]


@pytest.mark.parametrize("lens", LENSES)
def test_undistorting_by_the_map_is_what_import_makes(lens: str, tmp_path: Path) -> None:
    footage = footage_of(lens)
    write_st_maps(footage, working_camera(footage.camera, 120), tmp_path)
    positions = st_map(tmp_path / "undistort.exr")
    assert positions.shape == (150, 240, 2)
    imported = at_work_size(picture(), footage, footage.camera).astype(np.float32)
    inside = (positions > 2).all(axis=-1) & (positions < (238, 148)).all(axis=-1)
    assert inside.mean() > 0.8
    assert np.abs(read_at(picture(), positions) - imported)[inside].max() < 2.0
    # It is no identity: the corners are pixels off.
    y, x = np.mgrid[:150, :240] + 0.5
    assert np.abs(positions - np.stack([x, y], axis=-1)).max() > 3


@pytest.mark.parametrize("lens", LENSES)
def test_back_and_forth_is_the_same_place(lens: str, tmp_path: Path) -> None:
    footage = footage_of(lens)
    write_st_maps(footage, working_camera(footage.camera, 120), tmp_path)
    undistort, redistort = (st_map(tmp_path / f"{n}.exr") for n in ("undistort", "redistort"))
    y, x = np.mgrid[:150, :240] + 0.5
    both = np.stack([read_at(undistort[..., k], redistort) for k in range(2)], axis=-1)
    inside = (redistort > 3).all(axis=-1) & (redistort < (237, 147)).all(axis=-1)
    assert inside.mean() > 0.6
    assert np.abs(both - np.stack([x, y], axis=-1))[inside].max() < 0.02
    again = read_at(read_at(picture(), undistort), redistort)
    assert np.abs(inner(again - picture())[inner(inside)]).max() < 4


@pytest.mark.parametrize("lens", LENSES)
def test_world_points_are_where_the_working_picture_and_the_footage_agree(lens: str) -> None:
    footage = footage_of(lens)
    camera = working_camera(footage.camera, 100)
    points = footage.camera.centre + footage.camera.rays()[::7, ::7].reshape(-1, 3) * 9.0
    pixels, depth = footage_positions(footage, points)
    assert np.allclose(depth, 9.0)
    inside = (pixels > 1).all(axis=1) & (pixels < (239, 149)).all(axis=1)
    at = work_positions(footage, camera)
    found = np.stack([read_at(at[..., k], pixels[inside][None])[0] for k in range(2)], axis=1)
    assert inside.sum() > 500
    assert np.abs(found - camera.project(points[inside])[0]).max() < 0.02


def test_without_a_lens_both_differ_by_their_size_only() -> None:
    footage = Footage(Path("f.png"), footage_of("opencv").camera)
    at = work_positions(footage, footage.camera.resized(120, 75))
    y, x = np.mgrid[:150, :240] + 0.5
    assert np.allclose(at, np.stack([x, y], axis=-1) / 2, atol=1e-4)
