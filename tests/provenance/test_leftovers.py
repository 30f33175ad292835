"""Ground that stayed dark beside a removed object is told, and how near the object stood."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.camera import Camera
from unveil_core.provenance.leftovers import FAR_M, NEAR_M, Leftovers, RemovedPlaces, leftovers_of

EYE_M = 1.5
"""Height of the camera over the ground, metres."""


def over_ground() -> tuple[Camera, np.ndarray]:
    """A camera that looks along y, and the depth of level ground below it, up to the sky."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    camera = Camera(192, 128, 160.0, 160.0, 96.0, 40.0, pose)
    down = -camera.rays()[..., 2]
    return camera, np.where(down > 0.02, EYE_M / np.maximum(down, 0.02), 0).astype(np.float32)


def left_by(level: int, *, removed: np.ndarray | None = None, lower: bool = True) -> tuple[Leftovers, np.ndarray]:
    """What is told of a patch of grey ground (or of sky), delivered with a level, in a frame of 120; and its places."""
    camera, depth = over_ground()
    changed = np.zeros(depth.shape, dtype=bool)
    changed[(slice(80, 100) if lower else slice(10, 20)), 80:112] = True
    photograph = np.full((*depth.shape, 3), 120, np.uint8)
    delivered = np.where(changed[..., None], level, photograph).astype(np.uint8)
    places = RemovedPlaces(np.zeros((0, 3)) if removed is None else removed)
    points = camera.centre + depth[changed][:, None] * camera.rays()[changed]
    return leftovers_of(delivered, photograph, changed, depth, camera, places), points


def middle(values: np.ndarray) -> float:
    return float(values.reshape(20, 32)[10, 16])


def test_dark_ground_is_told_by_its_share() -> None:
    assert middle(left_by(90)[0].darker) == pytest.approx(0.25, abs=0.02)


def test_lighter_ground_is_no_leftover() -> None:
    assert (left_by(140)[0].darker == 0).all()


def test_a_dark_sky_is_no_leftover() -> None:
    found, _ = left_by(60, removed=np.zeros((1, 3)), lower=False)
    assert (found.darker == 0).all() and (found.near == 0).all()


def test_without_seen_ground_nothing_is_told() -> None:
    camera, depth = over_ground()
    everything = np.ones(depth.shape, dtype=bool)
    dark = np.full((*depth.shape, 3), 20, np.uint8)
    assert (leftovers_of(dark, dark, everything, depth, camera, RemovedPlaces(np.zeros((0, 3)))).darker == 0).all()


def test_near_falls_with_the_distance_from_what_was_removed() -> None:
    _, points = left_by(90)
    at = points.reshape(20, 32, 3)[10, 16]
    for away in (0.0, 1.0, 2.0):
        found, _ = left_by(90, removed=at[None] + [0, 0, away])
        assert middle(found.near) == pytest.approx(np.exp(-away / NEAR_M), rel=0.01)
    assert (left_by(90, removed=at[None] + [0, 0, 2 * FAR_M])[0].near == 0).all()
    assert (left_by(90)[0].near == 0).all()


def test_a_wide_frame_tells_the_same() -> None:
    """It is looked at in every fourth pixel."""
    camera, _ = over_ground()
    wide = Camera(768, 512, 640.0, 640.0, 384.0, 160.0, camera.world_to_camera)
    down = -wide.rays()[..., 2]
    depth = np.where(down > 0.02, EYE_M / np.maximum(down, 0.02), 0).astype(np.float32)
    changed = np.zeros(depth.shape, dtype=bool)
    changed[320:400, 320:448] = True
    photograph = np.full((*depth.shape, 3), 120, np.uint8)
    delivered = np.where(changed[..., None], 90, photograph).astype(np.uint8)
    found = leftovers_of(delivered, photograph, changed, depth, wide, RemovedPlaces(np.zeros((0, 3))))
    assert float(found.darker.reshape(80, 128)[40, 64]) == pytest.approx(0.25, abs=0.02)
