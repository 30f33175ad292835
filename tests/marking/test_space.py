"""Which points are an object's, in a scene of boxes of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unveil_core.marking.space.clustering import clicked_points, cluster_around
from unveil_core.marking.space.scene_points import ScenePoints
from unveil_core.semantics.visibility import PointsInView

CELL = 0.12


def shell(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Points on the sides and the top of a box, and their normals."""
    a, b = np.array(low), np.array(high)
    places, normals = [], []
    for axis, end, side in ((0, a, -1.0), (0, b, 1.0), (1, a, -1.0), (1, b, 1.0), (2, b, 1.0)):
        others = [k for k in range(3) if k != axis]
        grid = np.stack(np.meshgrid(*[np.arange(a[k], b[k] + 1e-6, CELL) for k in others]), axis=-1).reshape(-1, 2)
        face = np.zeros((len(grid), 3))
        face[:, others], face[:, axis] = grid, end[axis]
        normal = np.zeros(3)
        normal[axis] = side
        places.append(face)
        normals.append(np.repeat(normal[None], len(face), axis=0))
    return np.concatenate(places), np.concatenate(normals)


def scene(*parts: tuple[np.ndarray, np.ndarray], colours: tuple[float, ...]) -> tuple[ScenePoints, np.ndarray]:
    """Points of some shells on level ground, each of one grey, and which one each is of."""
    positions = np.concatenate([p for p, _ in parts])
    of = np.repeat(np.arange(len(parts)), [len(p) for p, _ in parts])
    grey = np.array(colours)[of][:, None].repeat(3, axis=1)
    normals = np.concatenate([n for _, n in parts])
    return ScenePoints(positions, np.full(len(positions), CELL), normals, grey, positions[:, 2], None, ()), of


def clicked(points: ScenePoints, places: list[tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """The eight points nearest to each of some places in space, and the click of each."""
    index = [np.argsort(np.linalg.norm(points.positions - p, axis=1))[:8] for p in places]
    return np.concatenate(index), np.repeat(np.arange(len(places)), 8)


CAR = ((0.0, 0.0, 0.1), (4.4, 1.8, 1.4))
ON_CAR = [(0.5, 0.0, 0.8), (2.2, 0.9, 1.4), (4.0, 0.0, 0.6)]


def test_what_stands_apart_is_not_taken() -> None:
    points, of = scene(shell(*CAR), shell((5.4, 0.0, 0.1), (9.0, 1.8, 1.4)), colours=(0.5, 0.5))
    found = cluster_around(points, *clicked(points, ON_CAR), np.zeros(0, np.int64))
    assert found[of == 0].all() and not found[of == 1].any()


def test_a_hedge_that_the_car_touches_is_cut_off() -> None:
    """The hedge begins where the car ends: only the hollow between them, and colour, tell."""
    hedge = shell((-8.0, 1.85, 0.0), (14.0, 3.6, 2.6))
    points, of = scene(shell(*CAR), hedge, colours=(0.8, 0.35))
    found = cluster_around(points, *clicked(points, ON_CAR), np.zeros(0, np.int64))
    assert found[of == 0].mean() > 0.9 and found[of == 1].mean() < 0.05


def test_a_click_on_the_neighbour_parts_two_cars_that_touch() -> None:
    points, of = scene(shell(*CAR), shell((4.65, 0.0, 0.1), (8.6, 1.8, 1.4)), colours=(0.5, 0.5))
    inside, clicks = clicked(points, ON_CAR)
    outside, _ = clicked(points, [(5.5, 0.0, 0.8), (7.0, 0.9, 1.4)])
    found = cluster_around(points, inside, clicks, outside)
    assert found[of == 0].mean() > 0.9 and found[of == 1].mean() < 0.1


def test_a_click_on_a_pane_is_not_the_car_before_it() -> None:
    """Two clicks hit a tailgate ten metres away. Where the third is no point comes back, but one of a mirror beside it."""
    tailgate = [(100 + 4 * k, 200 + 3 * (k % 3), 10.0 + 0.05 * k) for k in range(12)]
    mirror = [(176, 196, 7.8)]
    columns, rows, depth = np.array([*tailgate, *mirror]).T
    points, _ = scene((np.ones((13, 3)), np.ones((13, 3))), colours=(0.5,))
    seen = PointsInView(np.arange(13), rows.astype(np.int64), columns.astype(np.int64), depth)
    clicks = np.array([(110.0, 202.0), (132.0, 202.0), (170.0, 198.0)])
    hit, of = clicked_points(points, seen, clicks, 768)
    assert set(of) == {0, 1} and 12 not in hit
    # Alone, or where it is no nearer than the others, it is what was clicked.
    assert clicked_points(points, seen, clicks[2:] + (5.0, 0.0), 768)[0].tolist() == [12]
    beside = replace(seen, depth=np.append(depth[:12], 9.6))
    assert 12 in clicked_points(points, beside, clicks, 768)[0]


def test_the_ground_is_never_taken() -> None:
    x, y = np.meshgrid(np.arange(-5, 10, 0.2), np.arange(-5, 5, 0.2))
    ground = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), np.tile([0.0, 0.0, 1.0], (x.size, 1))
    points, of = scene(shell(*CAR), ground, colours=(0.5, 0.5))
    found = cluster_around(points, *clicked(points, ON_CAR), np.zeros(0, np.int64))
    assert found[of == 0].mean() > 0.95 and not found[of == 1].any()
