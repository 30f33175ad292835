"""Loose ends of what goes are told from what some frame shows."""

from __future__ import annotations

import numpy as np

from unveil_core.geometry.camera import Camera
from unveil_core.remove.unsupported import unsupported

OBJECT = np.array([0.0, 0.0, 10.0])
LOOSE = np.array([0.1, 0.0, 9.8])
BEHIND = np.array([0.0, 0.0, 10.4])
FAR_BEHIND = np.array([0.0, 0.0, 30.0])
MEANS = np.stack([OBJECT, LOOSE, BEHIND, FAR_BEHIND])
GONE = np.array([True, False, False, False])


def cameras(count: int) -> list[Camera]:
    """Side by side, 2 m apart, all looking along z."""
    poses = np.repeat(np.eye(4)[None], count, axis=0)
    poses[:, 0, 3] = -2.0 * (np.arange(count) - (count - 1) / 2)
    return [Camera(200, 100, 100.0, 100.0, 100.0, 50.0, pose) for pose in poses]


def masks_of(seen_from: list[Camera], width: int) -> list[np.ndarray]:
    """Masks so many pixels to either side of the object."""
    found = []
    for camera in seen_from:
        mask = np.zeros((100, 200), bool)
        column = int(camera.project(OBJECT[None])[0][0, 0])
        mask[:, max(0, column - width) : column + width] = True
        found.append(mask)
    return found


def test_a_loose_end_goes_and_what_a_frame_shows_beside_the_object_stays() -> None:
    views = cameras(4)
    masks = masks_of(views, 3)
    assert unsupported(MEANS[:2], GONE[:2], views, masks, reach=1.0).tolist() == [False, True]
    # From the outermost cameras what lies behind comes out beside the object.
    apart = [OBJECT, LOOSE, np.array([0.0, 0.0, 12.0]), FAR_BEHIND]
    assert unsupported(np.stack(apart), GONE, views, masks, reach=5.0).tolist() == [False, True, False, False]
    assert not unsupported(MEANS, GONE, views, masks, reach=0.05).any()


def test_frames_that_do_not_tell_of_the_object_count_neither_way() -> None:
    views = cameras(4)
    masks = masks_of(views, 4)
    blank = [np.zeros_like(m) for m in masks]
    # An unmasked object in far frames is no proof that its loose end is street.
    assert unsupported(MEANS, GONE, [*views, *views], [*masks, *blank], reach=1.0)[1]
    assert not unsupported(MEANS, GONE, views, [masks[0], *blank[1:]], reach=1.0).any()
    assert not unsupported(MEANS, GONE, views, blank, reach=1.0).any()
    for gone in (np.zeros(4, bool), np.ones(4, bool)):
        assert not unsupported(MEANS, gone, views, masks, reach=1.0).any()
