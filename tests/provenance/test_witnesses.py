"""What other frames show of a place: counted, averaged, and only where they really show it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inpaint.walls import before_wall
from unveil_core.delivery.views import EmptyView, EmptyViews
from unveil_core.provenance.witnesses import Seen, Witnesses, seen_by

Witness = tuple[EmptyView, np.ndarray]


def witness(
    x: float, level: int, *, distance: float = 3.0, depth: float | None = None, barred: bool = False
) -> Witness:
    """A view of the wall, all of one grey."""
    camera = before_wall(x, distance)
    shape = (camera.height, camera.width)
    plane = np.full(shape, distance if depth is None else depth, np.float32)
    return EmptyView(camera, plane, np.full(shape, barred)), np.full((*shape, 3), level, np.uint8)


def seen_in_the_middle(witnesses: list[Witness]) -> Seen:
    """What the others show of the middle of the first one's picture."""
    views = [view for view, _ in witnesses]
    mask = np.zeros(views[0].depth.shape, dtype=bool)
    mask[36, 48] = True
    return seen_by(Witnesses(EmptyViews([v.camera for v in views], views), [p for _, p in witnesses]), 0, mask)


def test_frames_that_show_the_place_are_counted_and_averaged() -> None:
    views = [witness(0, 0), witness(0.3, 100), witness(-0.3, 120)]
    seen = seen_in_the_middle(views)
    assert seen.count.tolist() == [2] and seen.color[0] == pytest.approx(110) and seen.spread[0] == pytest.approx(10)


def test_nobody_counts_who_looks_at_something_else() -> None:
    views = [witness(0, 0), witness(0.3, 100, barred=True), witness(-0.3, 120, depth=2.0), witness(50, 120)]
    seen = seen_in_the_middle(views)
    assert seen.count.tolist() == [0] and seen.color.tolist() == [[0, 0, 0]] and seen.spread.tolist() == [0]


def test_the_sky_is_seen_by_who_sees_sky_there() -> None:
    views = [witness(0, 0, depth=0.0), witness(5, 200, depth=0.0), witness(2, 100)]
    seen = seen_in_the_middle(views)
    assert seen.count.tolist() == [1] and seen.color[0] == pytest.approx(200)
