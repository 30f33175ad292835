"""What stands in for a removed object under another label goes with it; the street around it and behind it stays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.inpaint.walls import before_wall
from unveil_core.base.frame_cache import Frames
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow
from unveil_core.remove.remains import remains
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

OBJECT = (-0.6, 0.6, -0.6, 0.6)


def plate(part: tuple[float, float, float, float], z: float, opacity: float) -> Surfels:
    left, right, top, bottom = part
    x, y = (p.ravel() for p in np.meshgrid(np.arange(left, right, 0.08), np.arange(top, bottom, 0.08)))
    points = np.column_stack([x, y, np.full(len(x), z)])
    normals = np.repeat([[0.0, 0.0, -1.0]], len(points), axis=0)
    grey, label = np.full((len(points), 3), 128, np.uint8), np.zeros(len(points), np.int64)
    return surfels_from_points(points, grey, label, normals, np.full(len(points), 0.08), opacity=opacity)


def pixels_of_object(camera: Camera) -> np.ndarray:
    """(H, W) of a camera, which look straight at the wall."""
    places = camera.unproject(np.full((camera.height, camera.width), camera.world_to_camera[2, 3] - 1.0))
    left, right, top, bottom = OBJECT
    aside, down = places[..., 0], places[..., 1]
    return grow((aside > left) & (aside < right) & (down > top) & (down < bottom), 2)


def test_what_only_pixels_of_the_object_show_goes_with_it() -> None:
    wall, thing = plate((-4, 4, -2, 2), 0.0, 0.95), plate(OBJECT, -1.0, 0.4)
    ghost = plate((-0.3, 0.3, -0.3, 0.3), -0.9, 0.9)  # shines through the object's surface, with another label
    hidden = plate((-0.2, 0.2, -0.2, 0.2), -0.8, 0.9)  # behind the ghost: no frame shows it at all
    scene = concatenate([wall, thing, ghost, hidden])
    first = np.cumsum([0, len(wall), len(thing), len(ghost), len(hidden)])
    gone = np.zeros(len(scene), dtype=bool)
    gone[first[1] : first[2]] = True
    cameras = [before_wall(x, 4.0) for x in (-3.0, 0.0, 3.0)]
    masks = [pixels_of_object(c) for c in cameras]
    found = remains(scene, gone, cameras, masks)
    assert found[first[2] : first[3]].all()
    assert not found[gone].any()
    # Every place of the wall is seen beside the object by one of the three.
    assert not found[: first[1]].any()
    # Where nothing is removed, nothing goes.
    assert not remains(scene, gone, cameras, [np.zeros_like(m) for m in masks]).any()


def test_what_was_counted_before_an_interruption_is_not_counted_again(tmp_path: Path) -> None:
    scene = concatenate([plate((-4, 4, -2, 2), 0.0, 0.95), plate(OBJECT, -1.0, 0.4)])
    gone = np.zeros(len(scene), dtype=bool)
    cameras = [before_wall(x, 4.0) for x in (-3.0, -1.0, 0.5, 3.0)]  # two in each of two cells of the plan
    asked: list[int] = []

    def masks(ends_at: int | None) -> Sequence[np.ndarray]:
        def make(i: int) -> np.ndarray:
            if i == ends_at:
                raise InterruptedError
            asked.append(i)
            return pixels_of_object(cameras[i])

        return Frames(len(cameras), make)

    whole = remains(scene, gone, cameras, masks(None))
    assert whole.any() and asked == [0, 1, 2, 3]
    with pytest.raises(InterruptedError):
        remains(scene, gone, cameras, masks(3), Checkpoint(tmp_path / "state.npz", every_s=0.0))
    asked.clear()
    again = remains(scene, gone, cameras, masks(None), Checkpoint(tmp_path / "state.npz", every_s=0.0))
    assert np.array_equal(again, whole) and asked == [2, 3]
