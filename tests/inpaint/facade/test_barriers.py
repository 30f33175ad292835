"""Hedges, garden walls and fences that go on behind parked cars, on a straight street whose geometry is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inpaint.facade.test_continued import FAR, against_plane, street
from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.facade.barriers import Barriers, complete_barriers, read_barriers
from unveil_core.inpaint.facade.facade_chart import FacadeView, replaced_by
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

BARRIER_T, TOP = 5.0, 1.3
HEDGE, FENCE = 8, 4
COLORS = {HEDGE: (40, 90, 30), FENCE: (150, 100, 60)}
LAST = 24.0
Pieces = list[tuple[float, float, int]]
"""First and last arc length of pieces of a barrier, and their labels."""
HEDGES: Pieces = [(1.0, LAST, HEDGE)]


def surfels_of(pieces: Pieces, hidden: Float64, top: float = TOP) -> Surfels:
    """Surfels of a barrier where no car, s from and to, hides it up to a height."""
    parts = []
    for first, last, label in pieces:
        s, h = (p.ravel() for p in np.meshgrid(np.arange(first, last, 0.1), np.arange(0.05, top, 0.1), indexing="ij"))
        shown = ~((s > hidden[0]) & (s < hidden[1]) & (h < hidden[2]))
        points = np.column_stack([s, np.full(len(s), BARRIER_T), h])[shown]
        count = len(points)
        colors = np.tile(np.array(COLORS[label], np.uint8), (count, 1))
        towards = np.tile([0.0, -1.0, 0.0], (count, 1))
        parts.append(surfels_from_points(points, colors, np.full(count, label), towards, np.full(count, 0.1)))
    return concatenate(parts)


def view(camera: Camera, pieces: Pieces, car: Float64) -> FacadeView:
    """What a camera sees of a barrier past a car's box (2, 3): rays against the barrier's plane."""
    rays, z, at, near, hidden = against_plane(camera, BARRIER_T, car)
    image, wall = np.full((len(rays), 3), 130, np.uint8), np.zeros(len(rays), dtype=bool)
    for start, end, label in pieces:
        here = (z > 0) & (at[:, 2] > 0) & (at[:, 2] < TOP) & (at[:, 0] > start) & (at[:, 0] < end)
        # Darker at the foot: what is copied must keep its height.
        image[here] = np.array(COLORS[label]) * np.where(at[here, 2] < 0.4, 0.5, 1.0)[:, None]
        wall |= here
    wall &= ~hidden
    depth = np.where(wall, z, FAR)
    depth[hidden] = near[hidden]
    # The ground in front of the barrier, and a lawn behind it.
    ground = ~wall & ~hidden & (rays[:, 2] < 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth[ground] = (-camera.centre[2] / rays[:, 2])[ground]
    shape = (camera.height, camera.width)
    sky, removed = ~wall & ~hidden & (rays[:, 2] > 0), hidden
    planes = [p.reshape(shape) for p in (wall, sky, depth, removed)]
    return FacadeView(camera, image.reshape(*shape, 3), *planes)


def read(pieces: Pieces, car: tuple[float, float, float], surfels: Surfels | None = None) -> Barriers | None:
    """The left barriers, past a car from and to an arc length, of a height."""
    ground, cameras = street(np.inf)
    box = np.array([[car[0], 3.0, 0.0], [car[1], 4.4, car[2]]])
    seen = surfels_of(pieces, np.array([car[0] - 0.5, car[1] + 2.0, 0.9 * car[2]])) if surfels is None else surfels
    return read_barriers(ground, seen, [view(c, pieces, box) for c in cameras], left=True, texel_m=0.05)


def colors_of(surfels: Surfels) -> Float64:
    """(N, 3) sRGB levels."""
    return np.asarray((surfels.sh[:, 0].double().numpy() * 0.28209479177387814 + 0.5) * 255)


@pytest.mark.parametrize("height", [1.0, 1.5], ids=["its top is seen", "nothing of it is seen"])
def test_a_hedge_goes_on_behind_a_car_down_to_the_ground(height: float) -> None:
    barriers = read(HEDGES, (10.0, 14.0, height))
    assert barriers is not None
    found, filled = complete_barriers(barriers, sh_degree=0)
    assert found is not None and filled.sum() > 200
    assert (found.labels == HEDGE).all()
    places = found.means.double().numpy()
    assert np.abs(places[:, 1] - BARRIER_T).max() < 0.1
    assert places[:, 2].min() < 0.1 and places[:, 2].max() < TOP + 0.1
    # Before that it is seen past the car.
    assert np.histogram(places[:, 0], np.arange(11.5, 14, 0.25))[0].min() > 10
    foot, rest = places[:, 2] < 0.3, places[:, 2] > 0.5
    for part, share in ((foot, 0.5), (rest, 1.0)):
        assert np.median(np.abs(colors_of(found)[part] - share * np.array(COLORS[HEDGE]))) < 8


def test_a_gate_stays_open() -> None:
    """Through it the lawn behind is seen, past a car that hides its ends."""
    pieces: Pieces = [(1.0, 12.0, HEDGE), (15.0, LAST, HEDGE)]
    barriers = read(pieces, (9.0, 10.5, 0.6))
    assert barriers is not None
    s = barriers.chart.s_start + barriers.chart.texel * np.arange(len(barriers.top))
    assert (barriers.top[(s > 12.6) & (s < 14.4)] == 0).all()
    assert (barriers.top[(s > 2) & (s < 8)] > 0).all() and (barriers.top[(s > 16) & (s < 22)] > 0).all()


def test_a_fence_is_completed_with_fence_and_not_with_the_hedge_beside_it() -> None:
    barriers = read([(1.0, 8.0, HEDGE), (8.0, LAST, FENCE)], (9.0, 12.5, 1.0))
    assert barriers is not None
    found, _ = complete_barriers(barriers, sh_degree=0)
    assert found is not None
    behind = (found.means[:, 0] > 9.5).numpy() & (found.means[:, 2] > 0.5).numpy()
    assert behind.sum() > 100
    assert (found.labels.numpy()[behind] == FENCE).all()
    assert np.median(np.abs(colors_of(found)[behind] - COLORS[FENCE])) < 8


def scattered(deep: float, low: float, high: float) -> Surfels:
    """Plants that fill a box along the street."""
    rng = np.random.default_rng(0)
    count = 3000
    points = rng.uniform([4.0, BARRIER_T - deep / 2, low], [20.0, BARRIER_T + deep / 2, high], (count, 3))
    colors = np.tile(np.array(COLORS[HEDGE], np.uint8), (count, 1))
    return surfels_from_points(
        points, colors, np.full(count, HEDGE), np.tile([0.0, -1.0, 0.0], (count, 1)), np.full(count, 0.1)
    )


@pytest.mark.parametrize(
    "plants",
    [scattered(4.0, 0.0, 1.3), scattered(0.6, 1.6, 4.0), surfels_of([(10.0, 11.0, HEDGE)], np.zeros(3))],
    ids=["bushes", "crowns", "a trunk"],
)
def test_other_plants_are_no_hedge(plants: Surfels) -> None:
    assert read(HEDGES, (10.0, 14.0, 1.5), plants) is None


def test_a_hedge_on_the_other_side_is_none_of_this_side() -> None:
    ground, cameras = street(np.inf)
    car = np.array([[10.0, 3.0, 0.0], [14.0, 4.4, 1.5]])
    views = [view(c, HEDGES, car) for c in cameras]
    assert read_barriers(ground, surfels_of(HEDGES, np.zeros(3)), views, left=False) is None


def test_what_was_left_behind_a_car_makes_room_for_the_hedge() -> None:
    barriers = read(HEDGES, (10.0, 14.0, 1.5))
    assert barriers is not None
    _, filled = complete_barriers(barriers, sh_degree=0)
    left = surfels_of([(12.0, 12.5, HEDGE)], np.zeros(3))
    seen = surfels_of([(4.0, 4.5, HEDGE)], np.zeros(3))
    assert replaced_by(barriers.chart, filled, left).mean() > 0.8
    assert not replaced_by(barriers.chart, filled, seen).any()
