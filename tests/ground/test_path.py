"""The path of drives that stand, creep, jitter, and of several cameras."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.ground.test_street import look
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path, way_of
from unveil_core.ground.track import longest_track

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


def drive_of(yaws: dict[str, float] | None = None, **tracks: np.ndarray) -> Drive:
    """A drive of cameras that go through these places and look to the left of the way by ``yaws``, radians."""
    frames = [
        Frame(f"{i:03d}", name, camera, Path("none.png"))
        for name, centres in tracks.items()
        for i, camera in enumerate(cameras(centres, (yaws or {}).get(name, 0.0)))
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


YAWS = {"left": 1.2, "rear": np.pi, "right": -1.2, "ahead_left": 0.8}


@pytest.mark.parametrize("radius", [np.inf, 12.0])
def test_the_path_of_a_rig_is_that_of_the_camera_that_looks_ahead(radius: float) -> None:
    """Whichever is named first, and though in a bend the outer camera goes farther."""
    angle = np.arange(30.0) * 0.6 / radius if np.isfinite(radius) else np.zeros(30)
    way = np.c_[radius * np.sin(angle), radius * (1 - np.cos(angle))] if np.isfinite(radius) else DRIVE[:, :2]

    def track(ahead: float, aside: float, yaw: float) -> list[Camera]:
        forward, left = (np.c_[np.cos(angle + a), np.sin(angle + a)] for a in (0, np.pi / 2))
        centres = np.c_[way + ahead * forward + aside * left, np.full(30, 1.6)]
        return [look(c, a + yaw) for c, a in zip(centres, angle, strict=True)]

    places = {
        "right": (0.2, -0.9),
        "rear": (-3.0, 0.0),
        "ahead_left": (1.0, 0.6),
        "front": (1.2, 0.0),
        "left": (0.2, 0.9),
    }
    frames = [
        Frame(f"{i:03d}", name, camera, Path("none.png"))
        for name, place in places.items()
        for i, camera in enumerate(track(*place, YAWS.get(name, 0.0)))
    ]
    drive = Drive(Path("."), tuple(frames), PointCloud(np.zeros((0, 3))))
    chosen = [drive.frames[i] for i in longest_track(drive)]
    assert [f.camera_name for f in chosen] == ["front"] * 30
    sides = replace(drive, frames=tuple(f for f in frames if f.camera_name in ("left", "rear")))
    path = fit_path([sides.frames[i].camera for i in longest_track(sides)])
    # Motion tells the direction: the way lies beside a side camera's path, and goes on as the car does. Smoothing cuts the bend.
    street = path.to_street(np.c_[way, np.zeros(30)])
    assert (np.diff(street[:, 0]) > 0).all() and np.abs(street[:, 1] + 0.9).max() < 0.3


def test_a_rig_that_starts_at_a_light_is_not_bent_by_it() -> None:
    """Of every camera the jitter is its own."""
    centres = {
        n: np.r_[jittered(DRIVE[0], 60, 0.02, k), DRIVE] + (0, 0.5 * k, 0) for k, n in enumerate(("rear", "left"))
    }
    centres["front"] = np.r_[jittered(DRIVE[0], 60, 0.02, 7), DRIVE]
    drive = drive_of(YAWS, **centres)
    track = longest_track(drive)
    assert drive.frames[track[0]].camera_name == "front"
    street = fit_path([drive.frames[i].camera for i in track]).to_street(np.c_[np.arange(50.0), np.full((50, 2), 3.0)])
    assert np.abs(street[:, 1] - 3).max() < 0.1


def test_a_rig_that_stands_looks_along_the_street_where_the_dataset_says() -> None:
    still = np.repeat(DRIVE[:1], 5, axis=0)
    drive = drive_of(YAWS, left=still, front=still)
    assert drive.frames[longest_track(drive)[0]].camera_name == "left"
    told = replace(drive, front_cameras=("front",))
    assert told.frames[longest_track(told)[0]].camera_name == "front"


def test_a_front_camera_that_saw_a_part_of_the_way_gives_no_path() -> None:
    drive = drive_of(YAWS, front=DRIVE[:15], left=DRIVE + (0, 0.9, 0))
    assert drive.frames[longest_track(drive)[0]].camera_name == "left"


@pytest.mark.parametrize("after", [3.0, 5.0])
def test_after_a_corner_the_street_goes_on_as_the_car_drove_last(after: float) -> None:
    """A corner of 6 m radius and a few metres of the new street: that one leads on, not the mean of both."""
    angle = np.linspace(0, np.pi / 2, 10)
    corner = np.c_[10 + 6 * np.sin(angle), 6 * (1 - np.cos(angle))]
    way = np.r_[np.c_[np.arange(10.0), np.zeros(10)], corner, np.c_[np.full(6, 16.0), 6 + np.linspace(0.5, after, 6)]]
    for driven in (way, way[::-1]):
        path = fit_path(cameras(np.c_[driven, np.full(len(driven), 1.6)]))
        ahead = np.c_[np.full(20, 16.0), 6 + after + np.arange(1.0, 21.0), np.zeros(20)]
        assert np.abs(path.to_street(ahead)[:, 1]).max() < 1.5
