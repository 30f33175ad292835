"""The ground from above: kinds, lines and walls where they lie, whatever path leads there."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inpaint.chart.test_chart import painted_street
from unveil_core.inpaint.chart.plan_view import CELL_M, UNKNOWN, PlanView, read_plan

ROAD, WALK, OTHER, WALL = range(4)


@pytest.fixture(scope="module")
def plan() -> tuple[PlanView, np.ndarray]:
    """A bend of a street seen from above, and the lateral offsets (P, Q) of its cells."""
    ground, cameras, images, labels, usable = painted_street()
    path = ground.path
    driven = path.nodes[(np.arange(len(path.nodes)) * path.step + path.start > 4)]
    low, high = driven[:80].min(axis=0) - 8, driven[:80].max(axis=0) + 8
    # A wall behind what was seen, and one that stands on seen ground.
    walls = path.to_world(np.array([[20.0, 8.0, 1.0], [10.0, 0.0, 1.0]]))
    view = read_plan(ground, low, high, cameras, images, labels, usable, kinds=(0, 1), walls=walls)
    rows, columns = view.kind.shape
    cells = np.stack(np.meshgrid(*(np.arange(n) * CELL_M for n in (rows, columns)), indexing="ij"), axis=-1) + low
    flat = np.column_stack([cells.reshape(-1, 2), np.zeros(rows * columns)]) @ path.axes
    return view, path.to_street(flat)[:, 1].reshape(rows, columns)


def test_road_and_sidewalk_lie_where_they_are(plan: tuple[PlanView, np.ndarray]) -> None:
    view, t = plan
    assert view.count == 4
    road, walk = (np.abs(t) < 3.7), (np.abs(t) > 4.3)
    assert (view.kind == ROAD).sum() > 3000 and (view.kind == WALK).sum() > 1000
    assert np.isin(view.kind[road], (ROAD, UNKNOWN)).mean() > 0.99
    assert np.isin(view.kind[walk], (WALK, UNKNOWN, WALL)).mean() > 0.99


def test_paint_is_a_line_and_asphalt_is_none(plan: tuple[PlanView, np.ndarray]) -> None:
    view, t = plan
    near = view.kind == ROAD
    assert view.line[near & (np.abs(t + 2.2) < 0.05)].mean() > 0.7
    assert np.abs(view.line[near & (np.abs(t) < 1.2)]).mean() < 0.25


def test_walls_are_known_only_where_no_ground_is_seen(plan: tuple[PlanView, np.ndarray]) -> None:
    view, t = plan
    assert not (view.kind[np.abs(t) < 3] == WALL).any()
    assert np.abs(t[view.kind == WALL].mean() - 8) < 0.2


def test_beside_the_view_nothing_is_known(plan: tuple[PlanView, np.ndarray]) -> None:
    view, _ = plan
    kind, line = view.at(np.array([view.corner - 1.0, view.corner + 1e5]))
    assert (kind == UNKNOWN).all() and not line.any()
