"""Which frames show what a hole hides: those that see it, and of these the ones that add most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.ground.test_street import look
from unveil_core.delivery.views import MOST_ASKED_VIEWS, EmptyView, EmptyViews, choose_sources, places_behind, sees
from unveil_core.geometry.camera import Camera

SIZE = (768, 512)


def view(x: float, barred: np.ndarray | None = None, wall_m: float = 0.0) -> EmptyView:
    """A view along +x over level ground from 1.6 m; where a wall stands ``wall_m`` before it, nothing behind it is seen."""
    found = over_ground(look(np.array([x, 0.0, 1.6]), 0.0).resized(*SIZE))
    depth = np.where(found.depth > 0, np.minimum(found.depth, wall_m), wall_m) if wall_m else found.depth
    return replace(found, depth=depth.astype(np.float32), barred=found.barred if barred is None else barred)


def over_ground(camera: Camera) -> EmptyView:
    rays = camera.rays()
    with np.errstate(divide="ignore"):
        depth = np.where(rays[..., 2] < 0, -camera.centre[2] / rays[..., 2], 0.0)
    depth[depth > 200] = 0
    return EmptyView(camera, depth.astype(np.float32), np.zeros(depth.shape, bool))


def chosen_of(points: np.ndarray, own: int, views: list[EmptyView], most: int) -> list[int]:
    return choose_sources(points, own, EmptyViews([v.camera for v in views], views), most)


def ground(x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    a, b = np.meshgrid(np.linspace(*x, 30), np.linspace(*y, 20))
    return np.stack([a.ravel(), b.ravel(), np.zeros(a.size)], axis=1)


def test_a_view_shows_what_is_open_to_it() -> None:
    points = ground((8, 12), (-2, 2))
    assert len(sees(view(0.0), points)[0]) == len(points)
    assert not len(sees(view(0.0, wall_m=5.0), points)[0])
    assert not len(sees(view(0.0), points + (0, 0, 1.0))[0])  # the ground, not what would be above it
    assert not len(sees(view(20.0), points)[0])
    barred = np.zeros(SIZE[::-1], bool)
    barred[:, : SIZE[0] // 2] = True
    left = points[:, 1] > 0
    seen = np.isin(np.arange(len(points)), sees(view(0.0, barred), points)[0])
    assert not seen[left].any() and seen[~left].all()


def test_the_view_that_shows_more_comes_first() -> None:
    points = ground((8, 12), (-2, 2))
    half = np.zeros(SIZE[::-1], bool)
    half[:, : SIZE[0] // 2] = True
    own = view(0.0)
    views = [own, view(0.5, half), view(1.0), view(0.5, wall_m=3.0)]
    chosen = chosen_of(points, 0, views, 3)
    assert chosen[0] == 2 and 0 not in chosen and 3 not in chosen
    assert chosen == [2]  # the half adds nothing to the whole


def test_halves_are_taken_together() -> None:
    points = ground((8, 12), (-2, 2))
    left, right = np.zeros((2, *SIZE[::-1]), bool)
    left[:, :368] = right[:, 400:] = True
    views = [view(0.0), view(0.5, left), view(0.5, right), view(0.4, right), view(0.4, wall_m=3.0)]
    chosen = chosen_of(points, 0, views, 6)
    assert set(chosen[:2]) in ({1, 2}, {1, 3}) and 4 not in chosen
    assert chosen_of(points, 0, views, 1) == chosen[:1]


def test_nothing_to_look_for_and_nothing_that_shows_it() -> None:
    points = ground((8, 12), (-2, 2))
    assert chosen_of(points[:0], 0, [view(0.0), view(1.0)], 3) == []
    assert chosen_of(points, 0, [view(0.0)], 3) == []
    assert chosen_of(points, 0, [view(0.0), view(1.0, wall_m=2.0)], 3) == []


def test_the_finer_of_two_alike_comes_first() -> None:
    """Two cameras at one place, one with half the focal length."""
    points = ground((14, 16), (-1, 1))
    fine = view(0.5)
    wide = replace(fine.camera, fx=fine.camera.fx / 2, fy=fine.camera.fy / 2)
    coarse = over_ground(wide)
    assert chosen_of(points, 0, [view(0.0), coarse, fine], 1) == [2]
    assert chosen_of(points, 0, [view(0.0), fine, coarse], 1) == [1]


def before_wall(x: float, y: float, heading: float) -> EmptyView:
    """A view of a wall at x = 30."""
    camera = look(np.array([x, y, 0.0]), heading, pitch=0.0)
    with np.errstate(divide="ignore"):
        depth = (30.0 - x) / camera.rays()[..., 0]
    wall = (camera.rays()[..., 0] > 0.1).astype(bool)
    return EmptyView(camera, np.where(wall, depth, 0).astype(np.float32), np.zeros(depth.shape, bool))


def test_cameras_that_look_elsewhere_do_not_use_up_the_views_that_are_asked() -> None:
    """More of them stand nearer than the only frame that shows the place."""
    places = np.stack([np.full(50, 30.0), np.linspace(-1, 1, 50), np.zeros(50)], axis=1)
    elsewhere = [before_wall(0.01 * k, 0.3, np.pi) for k in range(MOST_ASKED_VIEWS + 20)]
    views = [before_wall(0.0, 0.0, 0.0), *elsewhere, before_wall(5.0, 0.0, 0.0)]
    assert chosen_of(places, 0, views, 6) == [len(views) - 1]


def test_the_ground_is_seen_past_surfels_that_lie_under_it() -> None:
    points = ground((8, 12), (-2, 2))
    on_ground = np.ones(len(points), bool)
    sunk = view(0.0)
    for depth in (sunk.depth * 1.08, np.zeros_like(sunk.depth)):
        low = replace(sunk, depth=depth.astype(np.float32))
        assert not len(sees(low, points)[0])
        assert len(sees(low, points, on_ground)[0]) == len(points)
        assert not len(sees(low, points, ~on_ground)[0])
        own = EmptyViews([low.camera] * 2, [low, low])
        assert choose_sources(points, 0, own, 1) == [] and choose_sources(points, 0, own, 1, on_ground) == [1]
    assert not len(sees(view(0.0, wall_m=5.0), points, on_ground)[0])
    barred = np.ones(SIZE[::-1], bool)
    assert not len(sees(view(0.0, barred), points, on_ground)[0])


def test_without_a_ground_places_behind_are_those_of_the_scene() -> None:
    seen = view(0.0)
    rays = seen.camera.rays()[300:310, 300:310].reshape(-1, 3)
    depth = np.full(len(rays), 7.0)
    found = places_behind(seen.camera, rays, depth, None)
    assert not found.on_ground.any() and (found.depth == depth).all()
    np.testing.assert_allclose((found.points - seen.camera.centre) @ seen.camera.forward, 7.0)
