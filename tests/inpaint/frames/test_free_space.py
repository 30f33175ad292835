"""A wall 10 m away, and things that were taken to hang before it."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.free_space import BEFORE, BEFORE_M, STEP, FreeSpace

WALL_M = 10.0
SEEN_UP_TO = (1 - BEFORE) * WALL_M - BEFORE_M


def camera_at(x: float) -> Camera:
    pose = np.eye(4)
    pose[0, 3] = -x
    return Camera(96, 64, 80.0, 80.0, 48.0, 32.0, pose)


def plane(depth: float) -> np.ndarray:
    return np.full((64, 96), depth, dtype=np.float32)


def hole() -> np.ndarray:
    mask = np.zeros((64, 96), dtype=bool)
    mask[25:40, 40:60] = True
    return mask


def behind(free: FreeSpace, begin: float, *, ceiling: float = np.inf, furthest: float = 30.0) -> np.ndarray:
    found = free.behind(
        camera_at(0), hole(), np.full((64, 96), begin), ceiling=np.full((64, 96), ceiling), furthest=furthest
    )
    np.testing.assert_array_equal(found[~hole()], begin)
    return found[hole()]


@pytest.mark.parametrize("begin", [3.0, 4.5, 6.0, 8.0])
def test_what_another_frame_sees_through_is_pushed_back_to_what_it_shows(begin: float) -> None:
    own = FreeSpace([camera_at(0), camera_at(1.0)], [plane(begin), plane(WALL_M)])
    found = behind(own, begin)
    assert (found >= SEEN_UP_TO).all()
    assert (found <= STEP * SEEN_UP_TO).all()


def test_nothing_is_hung_before_the_object_that_hides_it() -> None:
    found = behind(FreeSpace([camera_at(0)], [plane(6.0)]), 2.0)
    assert (found >= 0.9 * 6.0 - BEFORE_M).all()


def test_what_lies_on_what_is_shown_stays() -> None:
    np.testing.assert_array_equal(behind(FreeSpace([camera_at(1)], [plane(WALL_M)]), WALL_M), WALL_M)


def test_what_no_frame_shows_stays() -> None:
    away = Camera(96, 64, 80.0, 80.0, 48.0, 32.0, np.diag([-1.0, 1.0, -1.0, 1.0]))
    np.testing.assert_array_equal(behind(FreeSpace([away], [plane(WALL_M)]), 3.0), 3.0)
    np.testing.assert_array_equal(behind(FreeSpace([], []), 3.0), 3.0)


def test_the_search_ends_at_the_ground() -> None:
    found = behind(FreeSpace([camera_at(1)], [plane(WALL_M)]), 3.0, ceiling=5.0)
    np.testing.assert_allclose(found, 5.0)


def test_before_the_sky_there_is_nothing() -> None:
    assert (behind(FreeSpace([camera_at(1)], [plane(np.inf)]), 3.0) >= 30.0).all()


def test_large_holes_are_asked_by_blocks() -> None:
    """As many pixels as are asked for, and four times as many, come out alike."""
    found = []
    for scale in (1, 4):
        camera = Camera(96 * scale, 64 * scale, 80.0 * scale, 80.0 * scale, 48.0 * scale, 32.0 * scale, np.eye(4))
        everything = np.ones((64 * scale, 96 * scale), dtype=bool)
        depth = np.full(everything.shape, 2.0)
        free = FreeSpace([camera_at(0.5)], [plane(WALL_M)])
        pushed = free.behind(camera, everything, depth, ceiling=np.full(everything.shape, np.inf), furthest=30.0)
        found.append(pushed[::scale, ::scale])
    assert (np.abs(found[0] - found[1]) < 1e-9).mean() > 0.95


def test_no_hole_changes_nothing() -> None:
    depth = np.full((64, 96), 3.0)
    free = FreeSpace([camera_at(1)], [plane(WALL_M)])
    none = np.zeros((64, 96), dtype=bool)
    np.testing.assert_array_equal(free.behind(camera_at(0), none, depth, ceiling=depth, furthest=9.0), depth)
