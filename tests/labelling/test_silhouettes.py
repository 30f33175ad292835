"""Where boxes lie in a picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.labelling.parked_row import HEIGHT, WIDTH, camera_at
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Frame
from unveil_core.labelling.leftovers import far_queues, strays_in_view
from unveil_core.labelling.object_points import ObjectPoints, Stray
from unveil_core.labelling.silhouettes import box_hull, drawn_in, silhouettes

CAMERA = camera_at(0.0)
BOX = TrackedBox(3, "car", (12.0, 0.5, 0.8), (4.0, 1.8, 1.6), 0.3)


def frame_of(*boxes: TrackedBox, time: float | None = None) -> Frame:
    return Frame("00", "front", CAMERA, Path("none.png"), boxes=boxes, timestamp=time)


def test_a_hull_covers_its_box() -> None:
    hull = box_hull(BOX, CAMERA)
    assert hull is not None
    inner = np.random.default_rng(0).uniform(-1, 1, (2000, 3)) * np.asarray(BOX.size) / 2
    cos, sin = np.cos(BOX.yaw), np.sin(BOX.yaw)
    places = inner @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + BOX.centre
    seen, held = CAMERA.fall_in(places, hull)
    assert seen.all()
    assert held[seen].mean() > 0.99
    assert hull.sum() < 1.15 * len(np.unique(np.floor(CAMERA.project(places)[0]), axis=0)) * 1.6


@pytest.mark.parametrize(
    ("centre", "seen"), [((-12.0, 0, 0.8), False), ((0.5, 0, 0.8), True), ((12.0, 80, 0.8), False)]
)
def test_boxes_behind_about_and_beside_the_camera(centre: tuple[float, float, float], seen: bool) -> None:
    box = replace(BOX, centre=centre)
    assert (box_hull(box, CAMERA) is not None) == seen
    assert len(silhouettes(frame_of(box), {})) == seen


def test_near_ones_come_first_and_what_stays_is_left_out() -> None:
    far, sign = replace(BOX, id=1, centre=(30.0, 0, 0.8)), replace(BOX, id=9, class_name="traffic sign")
    assert [s.box.id for s in silhouettes(frame_of(far, sign, BOX), {})] == [3, 1]


def test_without_points_the_whole_box_is_likely() -> None:
    (found,) = silhouettes(frame_of(BOX), {})
    hull = box_hull(BOX, CAMERA)
    assert hull is not None
    assert (found.likely >= hull[found.window]).all()
    assert 0.2 < found.sure.sum() / hull.sum() < 0.9
    assert (found.sure <= found.likely).all()
    assert (found.likely <= found.possible).all()


def test_a_tiny_box_is_taken_whole() -> None:
    (found,) = silhouettes(frame_of(replace(BOX, centre=(45.0, 0.5, 0.8))), {})
    assert found.tiny


def test_a_loose_box_is_drawn_in_to_its_points() -> None:
    surface = np.random.default_rng(0).uniform(-1, 1, (4000, 3)) * (1.8, 0.8, 0.7)
    tight = drawn_in(BOX, surface)
    np.testing.assert_allclose(tight.size, (3.66, 1.66, 1.46), atol=0.05)
    np.testing.assert_allclose(tight.centre, BOX.centre, atol=0.03)
    assert drawn_in(BOX, surface[:20]) == BOX
    rear = drawn_in(BOX, surface[surface[:, 0] < -0.5])  # nobody saw how far it reaches forward
    assert rear.size[0] == pytest.approx(4.0 - 0.17, abs=0.05)


def test_points_narrow_what_is_possible() -> None:
    upper = np.random.default_rng(0).uniform(-1, 1, (3000, 3)) * (1.9, 0.85, 0.75)
    left = upper[upper[:, 1] > 0]
    (whole,) = silhouettes(frame_of(BOX), {3: ObjectPoints(np.array([0.0]), (upper,))})
    (half,) = silhouettes(frame_of(BOX), {3: ObjectPoints(np.array([0.0]), (left,))})
    assert half.possible.sum() < whole.possible.sum()


def test_strays_are_shown_at_their_time_before_what_hides_them() -> None:
    stray = Stray(1.0, np.array([[20.0, 0.0, 1.0], [25.0, 4.0, 1.0]]), np.array([13, 11], np.uint8))
    open_view = np.full((HEIGHT, WIDTH), np.inf, np.float32)
    shown = strays_in_view([stray], frame_of(time=1.05), open_view)
    assert set(np.unique(shown)) == {11, 13, 255}
    assert (strays_in_view([stray], frame_of(time=2.0), open_view) == 255).all()
    assert (strays_in_view([stray], frame_of(), open_view) == 255).all()
    assert (strays_in_view([stray], frame_of(time=1.0), np.full_like(open_view, 5.0)) == 255).all()


def test_queues_close_only_among_far_vehicles_and_not_over_open_street() -> None:
    row = [replace(BOX, id=i, centre=(60.0, y, 0.8), yaw=0.0) for i, y in ((1, -3.4), (2, 0.0), (3, 3.4))]
    owner = np.zeros((HEIGHT, WIDTH), np.uint16)
    for box in row:
        hull = box_hull(box, CAMERA)
        assert hull is not None
        owner[hull] = box.id
    closed = np.zeros(owner.shape, dtype=bool)
    found = silhouettes(frame_of(*row), {})
    between = far_queues(found, owner, closed) == 13
    assert between.sum() > 5
    assert not between[owner > 0].any()
    assert (far_queues(found, owner, ~closed) == 255).all()
    assert (far_queues(found[:2], owner, closed) == 255).all()
    near = silhouettes(frame_of(*(replace(b, centre=(20.0, b.centre[1], 0.8)) for b in row)), {})
    assert (far_queues(near, owner, closed) == 255).all()
