"""Exposures found from the points of a drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.hard_drives import make_tiny_street, replace_images
from tests.small_rig import FRONT, LEFT, REAR, RIGHT, make_small_rig
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.optimize.exposure import affine_between, fit_exposures

SAMPLES = Path(__file__).parents[2] / "sample_scenes"
GAINS = np.exp(np.linspace(np.log(0.6), np.log(1.1), 8))[:, None] * (1.0, 0.95, 1.05)


def spoilt(image: np.ndarray, i: int) -> np.ndarray:
    """A picture (BGR) of another exposure, the sixth one dazzled."""
    dim = np.clip(image / 255 * GAINS[i, ::-1], 0, 1)
    return np.full_like(image, 255) if i == 5 else (dim * 255).round().astype(np.uint8)


@pytest.mark.parametrize("name", ["parked_street", "country_road"])
def test_a_steady_camera_is_left_alone(name: str) -> None:
    found = fit_exposures(localized(open_drive(SAMPLES / name)))
    assert found.is_identity and not found.known and found.figures["used"] is False
    assert found.figures["rms_with"] > 0.93 * found.figures["rms_without"]


def test_gains_are_found_and_a_frame_that_tells_nothing_is_between_its_neighbours(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", [float(i) for i in range(8)])
    replace_images(path, "images", spoilt)
    drive = localized(open_drive(path))
    found = fit_exposures(drive)
    assert found.figures["used"] and found.figures["rms_with"] < 0.5 * found.figures["rms_without"]
    gain = np.stack([found.of(f).gain for f in drive.frames])
    grey = 0.5 * gain + np.stack([found.of(f).bias for f in drive.frames])
    wanted = 0.5 * GAINS / np.exp(np.log(np.delete(GAINS, 5, axis=0)).mean(axis=0))
    # Blue is never near mid grey on this street, so that its gain and bias are hard to tell apart.
    assert np.abs(np.delete(grey / wanted, 5, axis=0) - 1).max() < 0.05
    assert (gain[4] < gain[5]).all() and (gain[5] < gain[6]).all()
    again = fit_exposures(drive)
    assert all((again.of(f).gain == found.of(f).gain).all() for f in drive.frames)


def test_a_render_is_brought_to_its_photograph_by_least_squares() -> None:
    canonical = np.random.default_rng(0).random((20, 30, 3))
    photograph = np.clip((canonical * (0.5, 0.8, 1.3) + (0.1, 0.0, -0.1)) * 255, 0, 255).round().astype(np.uint8)
    gain, bias = affine_between(canonical, photograph)
    assert np.allclose(gain, (0.5, 0.8, 1.3), atol=0.01) and np.allclose(bias, (0.1, 0.0, -0.1), atol=0.01)


def greys(drive: Drive, camera: str) -> np.ndarray:
    """(F, 3) what each photograph of a camera shows of mid grey."""
    found = fit_exposures(drive)
    frames = [f for f in drive.frames if f.camera_name == camera]
    return np.stack([0.5 * found.of(f).gain + found.of(f).bias for f in frames])


def test_cameras_of_a_rig_that_held_still_get_one_exposure_each(tmp_path: Path) -> None:
    """Each alone has nothing to explain, and what they share is little of it all."""
    gains = {"front": (1.0, 1.0, 1.0), "left": (0.75, 0.8, 0.85), "right": (1.2, 1.15, 1.1), "rear": (0.9, 0.9, 0.9)}
    cameras = [replace(c, gain=gains[c.name]) for c in (FRONT, LEFT, RIGHT, REAR)]
    drive = localized(open_drive(make_small_rig(tmp_path / "rig", cameras, np.arange(0.0, 14.0))))
    figures = fit_exposures(drive).figures
    assert figures["used"] and figures["by_frame"] == [] and figures["rms_with"] < 0.7 * figures["rms_without"]
    front = greys(drive, "front")
    for name, gain in gains.items():
        own = greys(drive, name)
        assert (own == own[0]).all()
        assert np.abs(own[0] / front[0] / gain - 1).max() < 0.05, name
    alike = localized(open_drive(make_small_rig(tmp_path / "alike", [FRONT, LEFT, RIGHT], np.arange(0.0, 14.0))))
    assert fit_exposures(alike).is_identity


def test_a_camera_whose_exposure_varies_does_not_drag_the_others_along(tmp_path: Path) -> None:
    path = make_small_rig(
        tmp_path / "rig", [FRONT, replace(LEFT, yaw=45.0, gain=(0.8, 0.8, 0.8))], np.arange(0.0, 12.0)
    )
    change = np.exp(np.linspace(np.log(1.0), np.log(0.6), 12))
    for i, file in enumerate(sorted((path.parent / "images/front").iterdir())):
        image = cv2.imread(str(file))
        cv2.imwrite(str(file), (image * change[i]).round().astype(np.uint8))
    drive = localized(open_drive(path))
    assert fit_exposures(drive).figures["by_frame"] == ["front"]
    front, left = greys(drive, "front"), greys(drive, "left")
    assert np.ptp(left, axis=0).max() == 0
    # Blue is never near mid grey on this street.
    assert np.abs(front / front[:1] / change[:, None] - 1)[:, :2].max() < 0.04
    assert np.abs(left[0] / front[0] / 0.8 - 1).max() < 0.05


def test_what_joins_a_rare_camera_to_the_others_is_not_outvoted(tmp_path: Path) -> None:
    path = make_small_rig(
        tmp_path / "rig", [FRONT, replace(LEFT, yaw=90.0, every=5, gain=(0.85,) * 3)], np.arange(20.0)
    )
    drive = localized(open_drive(path))
    assert np.abs(greys(drive, "left")[0] / greys(drive, "front")[0] / 0.85 - 1).max() < 0.03
