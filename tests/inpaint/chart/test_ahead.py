"""The street ahead of the last camera, found by what is seen of it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ground.test_street import look
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import StreetPath, fit_path
from unveil_core.inpaint.chart.ahead import follow_street
from unveil_core.inpaint.chart.plan_view import CELL_M, UNKNOWN, PlanView

ROAD, WALK, OTHER, WALL = range(4)
DRIVEN_M = 40


def course(bend: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (N + 1, 2) and headings (N + 1,) of a street whose metres bend so (N,), radians."""
    heading = np.concatenate([[0.0], np.cumsum(bend)])
    middle = (heading[1:] + heading[:-1]) / 2
    legs = np.stack([np.cos(middle), np.sin(middle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(legs, axis=0)]), heading


def driven(bend: np.ndarray, count: int) -> list[Camera]:
    """Cameras on the first metres of a course."""
    places, heading = course(bend)
    return [look(np.array([*p, 1.6]), float(h)) for p, h in zip(places[:count], heading[:count], strict=True)]


def seen_from_above(street: StreetPath, rng: np.random.Generator) -> PlanView:
    """Road, edge lines, sidewalks and walls beside a path, with parked cars that hide some."""
    low, high = street.nodes.min(axis=0) - 20, street.nodes.max(axis=0) + 20
    shape = np.ceil((high - low) / CELL_M).astype(int)
    cells = np.stack(np.meshgrid(*(np.arange(n) * CELL_M for n in shape), indexing="ij"), axis=-1) + low
    flat = np.column_stack([cells.reshape(-1, 2), np.zeros(cells[..., 0].size)]) @ street.axes
    s, t = (street.to_street(flat)[:, k].reshape(shape) for k in (0, 1))
    kind = np.select([np.abs(t) < 4, np.abs(t) < 7, np.abs(np.abs(t) - 9) < 0.3], [ROAD, WALK, WALL], UNKNOWN)
    line = np.where(np.abs(np.abs(t) - 1.8) < 0.08, 1.0, 0.0) + 0.1 * rng.normal(size=kind.shape)
    parked = (np.abs(t) > 2) & (np.abs(t) < 5) & (s % 7 < 5)
    kind = np.where(parked, UNKNOWN, kind).astype(np.int8)
    return PlanView(low, kind, 4, np.where((kind == ROAD) | (kind == WALK), line, 0).astype(np.float32))


def off(path: StreetPath, street: StreetPath, end: np.ndarray) -> np.ndarray:
    """How far aside of a street a path lies 10, 20, 30 and 40 m ahead of a place (3,), metres."""
    s = path.to_street(end[None])[0, 0] + np.array([0, 10, 20, 30, 40])
    t = street.to_street(path.to_world(np.column_stack([s, np.zeros((5, 2))])))[:, 1]
    return t[1:] - t[0]


BENDS = {
    "a bend begins": np.r_[np.zeros(45), np.full(55, 1 / 60)],
    "a bend ends": np.r_[np.zeros(10), np.full(28, 1 / 50), np.zeros(62)],
    "an S": np.r_[np.full(40, 1 / 80), np.zeros(6), np.full(54, -1 / 50)],
    "a corner, left aslant": np.r_[np.zeros(20), np.full(14, np.pi / 2 / 14), np.zeros(66)],
}


@pytest.mark.parametrize("name", BENDS)
def test_the_street_is_followed_where_it_bends(name: str) -> None:
    cameras = driven(BENDS[name], DRIVEN_M)
    street = fit_path(driven(BENDS[name], 101))
    if "aslant" in name:
        # Once round the corner the car still turns by two degrees a metre.
        aslant = BENDS[name] - np.r_[np.zeros(34), np.full(66, np.radians(1.2))]
        cameras = driven(aslant, DRIVEN_M)
    path, end = fit_path(cameras), cameras[-1].centre
    at = float(path.to_street(end[None])[0, 0])
    found = follow_street(path, at, seen_from_above(street, np.random.default_rng(0)))
    before, after = (np.abs(off(p, street, end)) for p in (path, found))
    assert before[3] > 3
    assert after.max() < 0.6
    # What was driven stays, but for the smoothing of the joint.
    s = np.arange(0, at - 10)
    ways = [p.to_world(np.column_stack([s, np.zeros((len(s), 2))])) for p in (path, found)]
    assert np.abs(ways[0] - ways[1]).max() < 0.02


def test_a_straight_street_stays_straight() -> None:
    cameras = driven(np.zeros(100), DRIVEN_M)
    path = fit_path(cameras)
    view = seen_from_above(fit_path(driven(np.zeros(100), 101)), np.random.default_rng(1))
    assert np.abs(off(follow_street(path, DRIVEN_M - 1.0, view), path, cameras[-1].centre)).max() < 0.15


def test_where_nothing_is_seen_ahead_the_street_goes_on_as_it_was_driven() -> None:
    for bend in (np.zeros(100), np.full(100, 1 / 90)):
        cameras = driven(bend, DRIVEN_M)
        path = fit_path(cameras)
        nothing = PlanView(np.zeros(2), np.full((10, 10), UNKNOWN, dtype=np.int8), 4, np.zeros((10, 10), np.float32))
        found = follow_street(path, float(path.to_street(cameras[-1].centre[None])[0, 0]), nothing)
        assert len(found.nodes) == pytest.approx(len(path.nodes), abs=2)
        assert np.abs(off(found, path, cameras[-1].centre)).max() < 0.2
