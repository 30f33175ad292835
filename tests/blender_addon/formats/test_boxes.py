"""Boxes in the scene, and which of them lies under the pointer."""

from __future__ import annotations

import numpy as np

from blender_addon.formats.boxes import SceneBox, box_around, pick, within


def test_the_nearest_box_under_the_pointer_is_picked() -> None:
    """Seen along -z, as Blender's views are, with z up in the picture's y."""
    focal, width, height = 500.0, 640, 480
    perspective = np.array(
        [[2 * focal / width, 0, 0, 0], [0, 2 * focal / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]], np.float64
    )
    boxes = (
        SceneBox((0, 0, -10), (2, 2, 2), 0.4),
        SceneBox((1.2, 0, -20), (4, 4, 4), 0.0),
        SceneBox((0, 0, 0), (3, 3, 3), 0.0),
    )
    corners = np.stack([b.corners for b in boxes])

    def pixel(x: float, y: float, z: float) -> tuple[float, float]:
        return width / 2 + focal * x / -z, height / 2 + focal * y / -z

    def picked(*place: float) -> int | None:
        return pick(pixel(*place), corners, perspective, (width, height))

    # Where the first and the second overlap the nearer one is meant; the third, around the viewer, has no outline.
    assert picked(0, 0, -10) == 0 and picked(3.0, 0, -20) == 1 and picked(3.7, 1.9, -20) is None
    # Within the rectangle around the turned box, -73 to 73 pixels, but beside its outline; only that box is asked about.
    beside = (width / 2 - 70, height / 2 - 70)
    assert pick(beside, corners[:1], perspective, (width, height)) is None
    assert pick((width / 2 - 60, height / 2), corners[:1], perspective, (width, height)) == 0
    assert pick((5.0, 5.0), corners[:0], perspective, (width, height)) is None


def test_a_box_around_its_own_corners_is_itself() -> None:
    box = SceneBox((3.0, -2.0, 0.7), (4.2, 1.8, 1.5), 0.7)
    again = box_around(box.corners, 0.7)
    assert np.allclose(again.centre, box.centre) and np.allclose(again.size, box.size)


def test_a_rectangle_holds_the_boxes_whose_middle_it_holds() -> None:
    perspective = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]], np.float64)
    places = ((-2, 0, -10), (2, 0, -10), (2, 3, -10), (0, 0, 10))  # the last is behind the viewer
    corners = np.stack([SceneBox(place, (1, 1, 1), 0.3).corners for place in places])
    size = (200, 100)
    assert within((0, 0, 200, 100), corners, perspective, size).tolist() == [True, True, True, False]
    assert within((100, 0, 200, 100), corners, perspective, size).tolist() == [False, True, True, False]
    assert within((100, 0, 200, 60), corners, perspective, size).tolist() == [False, True, False, False]
    assert not within((0, 0, 5, 5), corners, perspective, size).any()
