"""Poses that photographs correct: exact observations bring wrong cameras back together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from unveil_core.base.types import Float64
from unveil_core.geometry.adjustment.bundle import Motions, adjusted, reprojection_errors, triangulated
from unveil_core.geometry.adjustment.features import Features
from unveil_core.geometry.adjustment.tracks import Tracks, joined_tracks
from unveil_core.geometry.camera import Camera


def looking(centre: Float64, turn: Float64 | None = None) -> Camera:
    """A camera that looks along y, z up, turned by a small rotation (3, 3) of the world."""
    axes = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    rotation = axes if turn is None else axes @ turn.T
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ centre
    return Camera(640, 360, 500.0, 500.0, 320.0, 180.0, pose)


def turned(vector: Float64) -> Float64:
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.fixture(scope="module")
def street() -> tuple[list[Camera], Tracks, Float64]:
    """Twelve cameras on their way, and 400 places in front of them as they see them."""
    random = np.random.default_rng(1)
    cameras = [looking(np.array([0.1 * np.sin(k), 1.0 * k, 1.5])) for k in range(12)]
    places = np.stack(
        [random.uniform(-12, 12, 400), random.uniform(8, 60, 400), random.uniform(0, 8, 400)],
        axis=1,
    )
    view, point, pixel = [], [], []
    for v, camera in enumerate(cameras):
        index, pixels, _ = camera.shown(places, nearest=1.0)
        view.append(np.full(len(index), v))
        point.append(index)
        pixel.append(pixels)
    tracks = Tracks(np.concatenate(view), np.concatenate(point), np.concatenate(pixel))
    often = np.bincount(tracks.point, minlength=400) >= 3
    return cameras, tracks.of_points(often), places[often]


def disturbed(cameras: list[Camera], seed: int, shift_m: float, turn_rad: float) -> list[Camera]:
    random = np.random.default_rng(seed)
    return [looking(c.centre + random.normal(0, shift_m, 3), turned(random.normal(0, turn_rad, 3))) for c in cameras]


def test_places_come_back_from_their_rays(street: tuple[list[Camera], Tracks, Float64]) -> None:
    cameras, tracks, places = street
    assert np.allclose(triangulated(cameras, tracks), places, atol=1e-3)
    assert reprojection_errors(cameras, tracks, places).max() < 1e-6


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_wrong_poses_are_brought_together(seed: int, street: tuple[list[Camera], Tracks, Float64]) -> None:
    cameras, tracks, _ = street
    given = disturbed(cameras, seed, 0.05, 0.01)
    before = np.median(reprojection_errors(given, tracks, triangulated(given, tracks)))
    motions, places = adjusted(given, np.arange(12), np.stack([c.centre for c in given]), tracks)
    mended = [motions.of_camera(c, k) for k, c in enumerate(given)]
    assert before > 1.0
    assert np.median(reprojection_errors(mended, tracks, places)) < 0.02
    # Where all of the drive lies no photograph tells; from one camera to the next they do.
    for wanted, found in ((cameras, mended), (cameras[::5], mended[::5])):
        for (a, b), (c, d) in zip(
            zip(wanted, wanted[1:], strict=False), zip(found, found[1:], strict=False), strict=True
        ):
            apart = a.world_to_camera @ b.camera_to_world @ np.linalg.inv(c.world_to_camera @ d.camera_to_world)
            assert np.abs(apart[:3, :3] - np.eye(3)).max() < 2e-3
            assert np.abs(apart[:3, 3]).max() < 0.06


def test_single_wrong_matches_change_little(street: tuple[list[Camera], Tracks, Float64]) -> None:
    cameras, tracks, _ = street
    given = disturbed(cameras, 3, 0.05, 0.01)
    random = np.random.default_rng(0)
    pixel = tracks.pixel.copy()
    wrong = random.random(len(pixel)) < 0.05
    pixel[wrong] += random.normal(0, 30, (int(wrong.sum()), 2))
    spoilt = replace(tracks, pixel=pixel)
    motions, places = adjusted(given, np.arange(12), np.stack([c.centre for c in given]), spoilt)
    mended = [motions.of_camera(c, k) for k, c in enumerate(given)]
    good = ~np.isin(tracks.point, tracks.point[wrong])
    assert np.median(reprojection_errors(mended, spoilt, places)[good]) < 0.15


def test_cameras_of_a_moment_move_together(street: tuple[list[Camera], Tracks, Float64]) -> None:
    cameras, tracks, _ = street
    moment = np.arange(12) // 2
    pivots = np.stack([(cameras[2 * k].centre + cameras[2 * k + 1].centre) / 2 for k in range(6)])
    wrong = Motions(
        np.stack([turned(np.array([0.004, -0.006, 0.003 * (k + 1)])) for k in range(6)]),
        np.tile([[0.03, -0.02, 0.05]], (6, 1)) * np.arange(6)[:, None] / 6,
        pivots,
    )
    given = [wrong.of_camera(c, int(k)) for c, k in zip(cameras, moment, strict=True)]
    motions, places = adjusted(given, moment, pivots, tracks)
    mended = [motions.of_camera(c, int(k)) for c, k in zip(given, moment, strict=True)]
    assert np.median(reprojection_errors(mended, tracks, places)) < 0.02
    for k in range(6):  # what is rigid stays so
        a, b = (cameras[i].world_to_camera @ cameras[i + 1].camera_to_world for i in (2 * k, 2 * k))
        c = mended[2 * k].world_to_camera @ mended[2 * k + 1].camera_to_world
        assert np.allclose(a, b) and np.allclose(a, c, atol=1e-9)


def test_tracks_that_show_a_place_twice_in_a_photograph_are_left_out() -> None:
    features = [Features(np.arange(6.0).reshape(3, 2) + 10 * v, np.zeros((3, 128), np.float32)) for v in range(3)]
    pairs = [
        (0, 1, np.array([[0, 0], [1, 1]])),
        (1, 2, np.array([[0, 0], [1, 1]])),
        (0, 2, np.array([[2, 1]])),  # the second track holds two features of the first photograph now
    ]
    tracks = joined_tracks(features, pairs)
    assert tracks.count == 1
    assert tracks.view.tolist() == [0, 1, 2]
    assert tracks.pixel.tolist() == [[0, 1], [10, 11], [20, 21]]


def test_no_matches_make_no_tracks() -> None:
    empty = Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    assert joined_tracks([empty, empty], [(0, 1, np.zeros((0, 2), np.int64))]).count == 0
