"""Virtual cars: met by rays where they are, put where nothing stands, hidden by what is nearer."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.mesh.street import Car, cast, street_camera
from unveil_core.base.errors import Cancelled, WorkspaceError
from unveil_core.evaluate.holdout.placement import SceneView, find_places, ground_shown, scene_view, see_cars
from unveil_core.evaluate.holdout.virtual_cars import HEIGHT_M, LENGTH_M, WIDTH_M, VirtualCar, cast_car, paint_car, park
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.ground.street_fit import fit_street_heights
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

UP = np.array([0.0, 0.0, 1.0])


def a_car(number: int = 1) -> VirtualCar:
    """Turned by 30 degrees."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    return VirtualCar(np.array([3.0, -2.0, 0.5]), axes, number, 0.0, 0.0)


def test_rays_meet_it_within_its_box_and_from_all_sides() -> None:
    car = a_car()
    generator = np.random.default_rng(0)
    origins = car.centre + generator.normal(size=(40, 3)) * (8, 8, 1) + np.array([0, 0, 3.0])
    reached = []
    for origin in origins:
        local = car.axes @ (origin - car.centre)
        if np.abs(local[0]) < 3 and np.abs(local[1]) < 2:
            continue  # not from within
        towards = car.centre + (generator.uniform(-1, 1, (200, 3)) * (2.6, 1.2, 1.0)) @ car.axes - origin
        hits = cast_car(car, origin, towards)
        met = np.isfinite(hits.depth)
        points = (origin + hits.depth[met, None] * towards[met] - car.centre) @ car.axes.T
        assert (np.abs(points) <= np.array([LENGTH_M / 2, WIDTH_M / 2, HEIGHT_M]) + 1e-9).all()
        assert (points[:, 2] >= -1e-9).all()
        # The side that is met looks at the camera.
        assert (np.sum(hits.normal[met] * (towards[met] @ car.axes.T), axis=1) < 0).all()
        assert np.allclose(np.linalg.norm(hits.normal[met], axis=1), 1) and not hits.normal[~met].any()
        reached.append(points)
    everything = np.concatenate(reached)
    extent = np.ptp(everything, axis=0)
    assert np.allclose(extent, (LENGTH_M, WIDTH_M, HEIGHT_M), atol=0.06)
    # The cabin is shorter than the body.
    assert np.ptp(everything[everything[:, 2] > 1.2, 0]) < 0.75 * LENGTH_M


def test_rays_beside_and_behind_miss() -> None:
    car = a_car()
    origin = car.centre + 10 * car.axes[0] + np.array([0, 0, 1.0])
    rays = np.stack([-car.axes[0], car.axes[0], -car.axes[0] + 0.5 * car.axes[1], UP])
    assert np.isfinite(cast_car(car, origin, rays).depth).tolist() == [True, False, False, False]


def test_paint_is_that_of_a_thing_and_black_where_there_is_none() -> None:
    car = a_car()
    camera_at = car.centre + 6 * car.axes[1] + np.array([0, 0, 1.4])
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 80), np.linspace(-0.5, 0.2, 50))
    rays = -car.axes[1] + u.reshape(-1, 1) * car.axes[0] + v.reshape(-1, 1) * UP
    hits = cast_car(car, camera_at, rays)
    paint = paint_car(car, camera_at, rays, hits)
    met = np.isfinite(hits.depth)
    assert met.any() and not paint[~met].any()
    assert len(np.unique(paint[met], axis=0)) > 30  # parts and shades, and not one flat colour
    other = paint_car(a_car(number=2), camera_at, rays, hits)
    assert np.abs(other[met].astype(int) - paint[met]).mean() > 10


# ------------------------------------------------------------------------------------------------------------------ places


def street(cars: tuple[Car, ...]) -> tuple[Ground, Surfels, list[SceneView], np.ndarray]:
    """The analytic street as a scene: its ground, its surfels, and what eight frames see of it."""
    cameras = [street_camera(1.5 * i, 96, 64) for i in range(8)]
    clouds, views = [], []
    for camera in cameras:
        seen = cast(camera, cars)
        depth = np.where(seen["depth"] > 0, seen["depth"], np.inf).astype(np.float64)
        near = depth < 30
        clouds.append(camera.centre + depth[near][:, None] * camera.rays()[near])
        views.append(SceneView(camera, depth, seen["car"] > 0))
    points = np.concatenate(clouds)
    path = fit_path(cameras)
    floor = points[points[:, 2] < 0.05]
    ground = fit_street_heights(path, floor)
    count = len(points)
    surfels = surfels_from_points(
        points,
        np.full((count, 3), 128, np.uint8),
        np.zeros(count, np.int64),
        np.tile(UP, (count, 1)),
        np.full(count, 0.1),
        opacity=0.9,
    )
    return ground, surfels, views, points


def overlap(car: VirtualCar, other: Car) -> bool:
    corners = car.corners()
    return bool(
        (corners[:, 0].min() < other.x + other.half_x)
        and (corners[:, 0].max() > other.x - other.half_x)
        and (corners[:, 1].min() < other.y + other.half_y)
        and (corners[:, 1].max() > other.y - other.half_y)
    )


def test_places_are_free_beside_the_path_apart_and_the_same_again() -> None:
    real = (Car(9.0, 2.6), Car(15.5, -2.8))
    ground, surfels, views, points = street(real)
    cars = find_places(ground, surfels, points, views, count=3)
    assert 1 <= len(cars) <= 3 and [c.number for c in cars] == list(range(1, len(cars) + 1))
    for car in cars:
        corners = car.corners()
        assert not any(overlap(car, other) for other in real)
        assert (np.abs(corners[:, 1]) < 5.05).all()  # the facades
        if corners[:, 0].min() < 11:  # where the camera drives
            assert np.abs(corners[:, 1]).min() > 0.9
        assert abs(car.centre[2]) < 0.05 and abs(car.axes[0] @ UP) < 0.02
        shown = [see_cars([car], s).number > 0 for s in views]
        assert sum(m.mean() > 0.004 for m in shown) >= 3
    for i, car in enumerate(cars):
        assert all(np.linalg.norm(car.centre - other.centre) >= 7 for other in cars[:i])
    again = find_places(ground, surfels, points, views, count=3)
    assert [c.centre.tolist() for c in again] == [c.centre.tolist() for c in cars]


def test_ground_is_what_lies_on_the_street_and_not_beside_a_facade() -> None:
    ground, _, views, _ = street(())
    view = views[0]
    places = view.camera.centre + np.where(np.isfinite(view.depth), view.depth, 0)[..., None] * view.camera.rays()
    everywhere = np.ones(view.depth.shape, dtype=bool)
    shown = ground_shown(view, ground, everywhere)
    assert (places[shown][:, 2] < 0.6).all() and np.isfinite(view.depth[shown]).all()
    level = np.isfinite(view.depth) & (places[..., 2] < 0.02) & (np.abs(places[..., 1]) < 3) & (view.depth < 15)
    assert level.sum() > 500 and shown[level].mean() > 0.9
    some = np.zeros_like(everywhere)
    some[40:, 20:60] = True
    assert np.array_equal(ground_shown(view, ground, some), shown & some)


def test_no_room_is_one_line() -> None:
    parked = tuple(
        Car(x, y, half_x=2.4) for x in (1.0, 6.5, 12.0, 17.5, 23.0, 28.5) for y in (-3.0, 0.0, 3.0) if x > 13 or y
    )
    ground, surfels, views, points = street(parked)
    with pytest.raises(WorkspaceError, match="No room for a virtual car: .*"):
        find_places(ground, surfels, points, views, count=2)


def test_looking_for_places_can_be_cancelled() -> None:
    ground, surfels, views, points = street(())

    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        find_places(ground, surfels, points, views, count=1, progress=stop)


def test_what_stands_nearer_hides_it_and_cars_hide_one_another() -> None:
    ground, _, views, _ = street(())
    back, front = park(ground, 16.0, 2.0, number=1), park(ground, 10.0, 2.0, number=2)
    camera = street_camera(0.0, 96, 64)
    free = see_cars([back], views[0])
    assert (free.number == 1).sum() > 60
    assert (free.depth[free.number > 0] < views[0].depth[free.number > 0] + 0.11).all()
    assert not free.color[free.number == 0].any()
    both = see_cars([back, front], views[0])
    assert (both.number == 1).sum() < (free.number == 1).sum()
    assert np.array_equal(see_cars([front, back], views[0]).number, both.number)
    # A real car in between: what the virtual one keeps are the pixels that the real one leaves.
    seen = cast(camera, (Car(10.0, 2.0),))
    behind = see_cars([back], SceneView(camera, np.where(seen["depth"] > 0, seen["depth"], np.inf), seen["car"] > 0))
    assert not (behind.number[seen["car"] > 0]).any()


def test_the_roughness_of_the_ground_hides_no_car_but_a_kerbside_box_does() -> None:
    """A reconstruction puts ground half a metre nearer than it is, at a grazing angle by a few centimetres of height."""
    ground, _, views, _ = street(())
    car = park(ground, 9.0, 2.0, number=1)
    plain = see_cars([car], views[0])
    rays = views[0].camera.rays()
    for height, expected in ((0.12, 1.0), (0.9, 0.75)):
        with np.errstate(divide="ignore"):
            at = (height - 1.6) / rays[..., 2]
        raised = (rays[..., 2] < 0) & (at < 6.4)
        view = SceneView(views[0].camera, np.where(raised, at, views[0].depth), views[0].excluded)
        kept = (see_cars([car], view).number > 0).sum() / (plain.number > 0).sum()
        assert kept == 1.0 if expected == 1.0 else kept < expected


def test_a_coarse_view_looks_through_the_same_pixels() -> None:
    camera = street_camera(2.0, 96, 64)
    depth = cast(camera)["depth"].astype(np.float64)
    view = SceneView(camera, depth, np.zeros(depth.shape, bool))
    coarse = view.coarse(32)
    assert coarse.depth.shape == (21, 32) and np.array_equal(coarse.depth, depth[1::3, 1::3])
    assert np.allclose(coarse.camera.rays(), camera.rays()[1::3, 1::3])
    assert view.coarse(500).depth.shape == depth.shape


def test_a_view_is_the_depth_of_the_scene_and_inf_for_the_sky() -> None:
    _, surfels, views, _ = street(())
    found = scene_view(surfels, views[0].camera, views[0].excluded)
    lower = np.s_[50:, 20:76]
    assert np.abs(found.depth[lower] - views[0].depth[lower]).max() < 0.25
    nothing = surfels.select(torch.zeros(len(surfels), dtype=torch.bool))
    empty = scene_view(nothing, views[0].camera, views[0].excluded)
    assert np.isinf(empty.depth).all()
