"""The path of drives that stand, creep, jitter, and of several cameras."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.ground.test_street import look
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.ground.fit import longest_track
from unveil_core.ground.path import fit_path, way_of

DRIVE = np.c_[np.arange(30.0), np.zeros(30), np.full(30, 1.6)]
"""30 m straight ahead."""


def jittered(centre: np.ndarray, count: int, noise: float, seed: int) -> np.ndarray:
    """So many places of a car that stands, by an odometry with white noise."""
    return centre + np.random.default_rng(seed).normal(0, noise, (count, 3)) * (1, 1, 0)


def cameras(centres: np.ndarray, heading: float = 0.0) -> list[Camera]:
    return [look(centre, heading) for centre in centres]


def kerb_error(centres: np.ndarray, x: np.ndarray) -> float:
    """How far off a kerb 3 m to the left of a straight street is found, metres."""
    street = fit_path(cameras(centres)).to_street(np.c_[x, np.full(len(x), 3.0), 0 * x])
    return float(np.abs(street[:, 1] - 3).max())


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01, 0.02])
def test_a_car_that_stands_does_not_bend_the_street(noise: float) -> None:
    """100 frames at a red light, before or after 30 m of way: the kerb is still straight 30 m beyond."""
    for seed in range(8):
        ends = np.r_[DRIVE, jittered(DRIVE[-1], 100, noise, seed)]
        starts = np.r_[jittered(DRIVE[0], 100, noise, seed), DRIVE]
        stops = np.r_[DRIVE[:15], jittered(DRIVE[14], 100, noise, seed), DRIVE[15:]]
        # Half a metre on from the last frame of the drive: one frame of those that stand counts.
        creeps = np.r_[DRIVE, jittered(DRIVE[-1] + (0.5, 0, 0), 100, noise, seed)]
        for centres in (ends, starts, stops, creeps):
            assert kerb_error(centres, np.arange(-30.0, 60.0)) < 0.1
        assert kerb_error(ends, np.arange(30.0, 60.0)) < 0.05


def test_noise_all_along_leaves_the_street_straight() -> None:
    errors = [kerb_error(jittered(DRIVE[0], 30, 0.02, seed) + DRIVE - DRIVE[0], np.arange(60.0)) for seed in range(20)]
    assert np.median(errors) < 0.35 and max(errors) < 1.0


def test_a_side_camera_that_creeps_does_not_lie_across_the_street() -> None:
    """A metre of way tells where the street leads, where the camera looks does not."""
    centres = np.c_[np.linspace(0, 1.0, 40), np.zeros(40), np.full(40, 1.6)]
    path = fit_path(cameras(centres, heading=np.pi / 2))
    assert np.abs(path.to_street(np.array([[20.0, 0, 0]]))[0, :2] - (20, 0)).max() < 1e-6
    standing = fit_path(cameras(jittered(centres[0], 40, 0.01, 0), heading=0.7))
    there = centres[0] + 20 * np.array([np.cos(0.7), np.sin(0.7), 0])
    assert np.abs(standing.to_street(there[None])[0, :2] - (20, 0)).max() < 0.1


def test_a_camera_that_looks_down_has_the_street_ahead_of_it() -> None:
    down = look(np.array([0.0, 0.0, 50.0]), 0.3, pitch=np.pi / 2)
    path = fit_path([down] * 3)
    assert np.abs(path.to_street(np.array([[20 * np.cos(0.3), 20 * np.sin(0.3), 0]]))[0, :2] - (20, 0)).max() < 1e-6


def drive_of(**tracks: np.ndarray) -> Drive:
    frames = [
        Frame(f"{i:03d}", name, camera, Path("none.png"))
        for name, centres in tracks.items()
        for i, camera in enumerate(cameras(centres))
    ]
    return Drive(Path("."), tuple(frames), PointCloud(np.zeros((0, 3))))


def test_the_path_is_that_of_the_longest_way_not_of_the_most_frames() -> None:
    tripod = jittered(np.array([5.0, 4.0, 1.6]), 300, 0.02, 0)
    assert way_of(tripod) == 0.0
    drive = drive_of(tripod=tripod, car=DRIVE)
    assert {drive.frames[i].camera_name for i in longest_track(drive)} == {"car"}
    # Of a rig all cameras go as far, in a bend not quite: the first is taken.
    rig = drive_of(front=DRIVE, left=DRIVE * (1.01, 1, 1) + (0, 1, 0))
    assert {rig.frames[i].camera_name for i in longest_track(rig)} == {"front"}
    assert longest_track(replace(rig, frames=rig.frames[:1])) == [0]
