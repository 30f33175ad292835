"""Poses corrected at import: by photographs of textured walls, for cameras and sweeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.importing.refined_poses import found_refinement, refined
from unveil_core.geometry.camera import Camera

COUNT = 10
WALLS = ((-6.0, 1), (7.0, -1))
"""Lateral offsets of two walls along the way, and the side that each faces."""


def texture(seed: int) -> NDArray[np.uint8]:
    random = np.random.default_rng(seed)
    fine = random.uniform(0, 255, (120, 480)).astype(np.float32)
    coarse = cv2.resize(random.uniform(0, 255, (24, 96)).astype(np.float32), (480, 120))
    picture = cv2.resize(0.5 * fine + 0.5 * coarse, (1920, 480), interpolation=cv2.INTER_CUBIC)
    return np.clip(picture, 0, 255).astype(np.uint8)


def camera_at(centre: Float64, yaw: float = 0.0, pitch: float = 0.0) -> Camera:
    """A camera that looks along y, turned a little."""
    axes = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    pose = np.eye(4)
    pose[:3, :3] = axes @ turn.T
    pose[:3, 3] = -pose[:3, :3] @ centre
    return Camera(480, 270, 380.0, 380.0, 240.0, 135.0, pose)


def photograph(camera: Camera) -> NDArray[np.uint8]:
    """The walls, 60 m long and 10 m high, as a camera sees them; grey elsewhere."""
    picture = np.full((camera.height, camera.width), 128, np.uint8)
    rays = camera.rays()
    for number, (offset, _) in enumerate(WALLS):
        with np.errstate(divide="ignore"):
            depth = (offset - camera.centre[0]) / rays[..., 0]
        place = camera.centre + depth[..., None] * rays
        u, v = (place[..., 1] + 5) * 1920 / 60, (8 - place[..., 2]) * 480 / 10
        shown = (depth > 0.5) & (u > 0) & (u < 1919) & (v > 0) & (v < 479)
        seen = cv2.remap(texture(number), u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
        picture[shown] = seen[shown]
    return picture


TRUE = [camera_at(np.array([0.05 * k, 0.8 * k, 1.6])) for k in range(COUNT)]


def drive(cameras: list[Camera], sweeps: tuple[Sweep, ...] = ()) -> Drive:
    frames = tuple(
        Frame(
            f"{k:02d}",
            "camera",
            c,
            Path(f"{k:02d}.png"),
            timestamp=0.1 * k,
            boxes=(TrackedBox(1, "car", (2.0, 10.0, 0.7), (4.0, 2.0, 1.5), 0.3),),
        )
        for k, c in enumerate(cameras)
    )
    return Drive(Path("drive"), frames, PointCloud(np.zeros((0, 3))), sweeps=sweeps)


@pytest.fixture(scope="module")
def photographs() -> list[NDArray[np.uint8]]:
    return [photograph(c) for c in TRUE]


def test_right_poses_stay_bit_for_bit(photographs: list[NDArray[np.uint8]]) -> None:
    given = drive(TRUE)
    by = found_refinement(given, TRUE, lambda i: (photographs[i], None))
    assert by.facts["refined"] is False
    assert by.facts["given_px"] < 0.25
    assert refined(given, by) is given


def test_too_few_features_change_nothing() -> None:
    grey = np.full((270, 480), 128, np.uint8)
    by = found_refinement(drive(TRUE), TRUE, lambda i: (grey, None))
    assert by.facts == {"refined": False, "tracks": 0}


def test_wrong_poses_are_mended_and_what_the_vehicle_measured_goes_with_them(
    photographs: list[NDArray[np.uint8]],
) -> None:
    random = np.random.default_rng(4)
    wrong = [camera_at(c.centre + random.normal(0, 0.02, 3), *random.normal(0, np.radians(0.5), 2)) for c in TRUE]
    # What a sweep measured, as the vehicle with its wrong pose placed it.
    place = np.array([[7.0, 14.0, 2.0]])
    own = (place - TRUE[6].centre) @ TRUE[6].world_to_camera[:3, :3].T
    placed = own @ wrong[6].world_to_camera[:3, :3] + wrong[6].centre
    sweep = Sweep(Path("sweep"), lambda: SweepPoints(placed), timestamp=0.6)
    given = drive(wrong, (sweep, replace(sweep, timestamp=None)))
    by = found_refinement(given, wrong, lambda i: (photographs[i], None))
    assert by.facts["refined"] is True
    assert by.facts["refined_px"] < 0.5 * by.facts["given_px"]
    mended = refined(given, by)

    def turn_apart(a: Camera, b: Camera, c: Camera, d: Camera) -> float:
        apart = a.world_to_camera @ b.camera_to_world @ np.linalg.inv(c.world_to_camera @ d.camera_to_world)
        return float(np.degrees(np.arccos(np.clip((np.trace(apart[:3, :3]) - 1) / 2, -1, 1))))

    for k in range(COUNT - 1):
        before = turn_apart(TRUE[k], TRUE[k + 1], wrong[k], wrong[k + 1])
        after = turn_apart(TRUE[k], TRUE[k + 1], mended.frames[k].camera, mended.frames[k + 1].camera)
        assert after < 0.1 < 0.12 + before
    # The sweep lies in its camera's axes where it lay, and one without a time stays.
    found = mended.sweeps[0].read().positions
    there = mended.frames[6].camera.world_to_camera
    assert np.allclose(found @ there[:3, :3].T + there[:3, 3], own, atol=1e-9)
    assert np.array_equal(mended.sweeps[1].read().positions, placed)
    box = mended.frames[6].boxes[0]
    assert 0 < abs(box.yaw - 0.3) < 0.05
    assert box.size == (4.0, 2.0, 1.5)


def test_cameras_of_one_moment_move_as_one(photographs: list[NDArray[np.uint8]]) -> None:
    random = np.random.default_rng(5)
    wrong = [camera_at(c.centre, *random.normal(0, np.radians(0.5), 2)) for c in TRUE]
    blind = [replace(c, world_to_camera=np.diag([1.0, 1, 1, 1]) @ c.world_to_camera) for c in wrong]
    one = drive(wrong)
    frames = (
        *one.frames,
        *(replace(f, camera_name="side", camera=c, boxes=()) for f, c in zip(one.frames, blind, strict=True)),
    )
    rig = replace(one, frames=frames)
    grey = np.full((270, 480), 128, np.uint8)
    by = found_refinement(rig, [f.camera for f in frames], lambda i: (photographs[i] if i < COUNT else grey, None))
    assert by.facts["refined"] is True
    assert by.moment.tolist() == [*range(COUNT), *range(COUNT)]
    moved = refined(rig, by)
    for k in range(COUNT):
        assert np.allclose(moved.frames[k].camera.world_to_camera, moved.frames[COUNT + k].camera.world_to_camera)
        assert not np.allclose(moved.frames[k].camera.world_to_camera, wrong[k].world_to_camera)
