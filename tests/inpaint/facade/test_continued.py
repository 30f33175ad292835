"""Facades that go on behind a parked car, on a street whose geometry is known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.ground.test_street import drive_on_circle, true_street
from tests.inpaint.sunny_street import box_surfels
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.ground.street_fit import fit_street_heights
from unveil_core.inpaint.facade.facade_chart import FacadeView, invented_facades, read_facade, replaced_by
from unveil_core.inpaint.facade.offsets import facade_offsets, fanned_out
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

FACADE_T = 6.0
FAR = 200.0


def street(radius: float) -> tuple[Ground, list[Camera]]:
    cameras = drive_on_circle(radius, 0.0)
    path = fit_path(cameras)
    s, t = np.meshgrid(np.arange(-2, 28, 0.3), np.arange(-7.5, 7.5, 0.3), indexing="ij")
    points = np.stack([s.ravel(), t.ravel(), np.zeros(s.size)], axis=1)
    return fit_street_heights(path, path.to_world(points)), cameras


def houses(radius: float, first: float = 0.0, last: float = 26.0) -> Surfels:
    """The facade on the left, FACADE_T metres from the cameras' way."""
    s, h = (p.ravel() for p in np.meshgrid(np.arange(first, last, 0.15), np.arange(0, 7, 0.15), indexing="ij"))
    here, nearer = (true_street(radius, s, np.full(len(s), t)) for t in (FACADE_T, FACADE_T - 1))
    points, normals = np.column_stack([here, h]), np.column_stack([nearer - here, np.zeros(len(s))])
    return surfels_from_points(
        points, np.full((len(s), 3), 120, np.uint8), np.zeros(len(s), np.int64), normals, np.full(len(s), 0.15)
    )


def stripes(along: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(N, 3) grey levels of the painted facade: windows every 3 m, a dark plinth."""
    grey = np.where((along % 3 < 1.2) & (height > 1), 60.0, 170.0)
    grey[height < 0.6] = 90.0
    return np.repeat(grey[:, None], 3, axis=1)


def against_plane(camera: Camera, t: float, car: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of each ray (N, 3) of a camera on a straight street its depth at the plane at ``t``, its place there (N, 3), its depth at the
    car's box, and whether it meets that."""
    rays = camera.rays().reshape(-1, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (t - camera.centre[1]) / rays[:, 1]
        first, second = (car[0] - camera.centre) / rays, (car[1] - camera.centre) / rays
    near, far = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return rays, z, camera.centre + z[:, None] * rays, near, (near <= far) & (near > 0)


def view(camera: Camera, car: np.ndarray) -> tuple[np.ndarray, ...]:
    """Image, wall, sky, depth and what the car hides, of a straight street: rays against the facade's plane and the car's box."""
    rays, z, at, near, hidden = against_plane(camera, FACADE_T, car)
    wall = (z > 0) & (at[:, 2] > 0) & (at[:, 2] < 7) & (at[:, 0] > 0) & (at[:, 0] < 26)
    image = np.where(wall[:, None], stripes(at[:, 0], at[:, 2]), 130.0)
    image[hidden] = (200, 0, 0)
    shape = (camera.height, camera.width)
    depth = np.where(wall, z, FAR)
    depth[hidden] = near[hidden]
    sky = ~wall & ~hidden & (rays[:, 2] > 0)
    planes = (p.reshape(shape) for p in (wall, sky, depth, hidden))
    return image.reshape(*shape, 3).astype(np.uint8), *planes


@pytest.mark.parametrize("radius", [np.inf, 60.0, -80.0])
def test_facades_are_found_where_houses_stand(radius: float) -> None:
    ground, _ = street(radius)
    s = np.arange(-1.5, 27, 0.1)
    offset = facade_offsets(houses(radius, 4.0, 20.0), ground, s, left=True)
    inside = (s > 5) & (s < 19)
    assert np.abs(offset[inside] - FACADE_T).max() < 0.1
    assert np.isnan(offset[(s < 3) | (s > 21)]).all()
    assert np.isnan(facade_offsets(houses(radius), ground, s, left=False)).all()


def test_a_piece_that_is_drawn_out_towards_the_cameras_is_no_step_of_the_facade() -> None:
    ground, _ = street(np.inf)
    wall = houses(np.inf)
    along = wall.means[:, 0]
    drawn = wall.select((along > 12.0) & (along < 12.5))
    drawn = replace(drawn, means=drawn.means - torch.tensor([0.0, 1.7, 0.0]))
    wall = concatenate([wall.select((along < 11.4) | (along > 13.0)), drawn])
    offset = facade_offsets(wall, ground, np.arange(1, 25, 0.1), left=True)
    assert np.abs(offset - FACADE_T).max() < 0.2


def test_what_lies_low_in_the_street_is_no_facade() -> None:
    """Wrong labels of a car's roof: many, in front of the wall, all at one height."""
    ground, _ = street(np.inf)
    wall = houses(np.inf)
    place = wall.means[:, 0], wall.means[:, 2]
    behind = wall.select((place[0] > 8) & (place[0] < 12) & (place[1] > 2.0) & (place[1] < 4.0))
    roof = wall.select((place[0] > 8) & (place[0] < 12) & (place[1] > 1.2) & (place[1] < 1.6))
    roof = concatenate(
        [replace(roof, means=roof.means - torch.tensor([0.0, 3.5 + d, 0.0])) for d in np.arange(0, 0.1, 0.01)]
    )
    beside = wall.select((place[0] < 8) | (place[0] > 12))
    assert len(roof) > len(behind)
    s = np.arange(1, 25, 0.1)
    offset = facade_offsets(concatenate([beside, behind, roof]), ground, s, left=True)
    assert np.abs(offset - FACADE_T).max() < 0.1
    alone = facade_offsets(roof, ground, s, left=True)
    assert np.isnan(alone).all()


def test_in_a_corner_the_outer_side_is_fanned_out() -> None:
    corner, straight = street(7.0)[0], street(np.inf)[0]
    s = np.arange(4.0, 9.0, 0.5)
    outer, inner = np.full(len(s), -12.0), np.full(len(s), 4.0)
    assert fanned_out(corner, s, outer).all()
    for ground, offset in ((corner, inner), (straight, outer), (corner, np.full(len(s), np.nan))):
        assert not fanned_out(ground, s, offset).any()


def test_a_wall_across_the_street_is_no_facade() -> None:
    ground, _ = street(np.inf)
    side = box_surfels(np.array([[9.9, 3.0, 0.0], [10.0, 3.2, 4.0]]))
    assert np.isnan(facade_offsets(side, ground, np.arange(0, 26, 0.1), left=True)).all()


def behind_a_car() -> tuple[Ground, list[FacadeView]]:
    """A straight street, and what is seen of its left side past a parked car."""
    ground, cameras = street(np.inf)
    car = np.array([[9.0, 3.2, 0.0], [13.0, 4.8, 1.5]])
    return ground, [FacadeView(c, *view(c, car)) for c in cameras]


def test_a_facade_goes_on_behind_a_car() -> None:
    ground, views = behind_a_car()
    chart = read_facade(ground, houses(np.inf), views, left=True, texel_m=0.05)
    assert chart is not None
    found = invented_facades(chart, label=3, sh_degree=1).walls
    assert found is not None and len(found) > 200
    assert (found.labels == 3).all()
    means = found.means.double().numpy()
    assert np.abs(means[:, 1] - FACADE_T).max() < 0.1
    assert np.abs(np.abs(found.normals().double().numpy()[:, 1]) - 1).max() < 0.01
    # Only behind the car, and as the facade goes on.
    assert means[:, 2].max() < 2.0
    grey = (found.sh[:, 0, 0].double().numpy() * 0.28209479177387814 + 0.5) * 255
    true = stripes(means[:, 0] - 0.0, means[:, 2])[:, 0]
    assert np.abs(grey - true).mean() < 0.6 * np.abs(170 - true).mean(), "plain wall is much farther off"
    assert read_facade(ground, houses(np.inf), views, left=False) is None


def test_what_was_left_behind_a_car_makes_room_for_the_completed_facade() -> None:
    ground, views = behind_a_car()
    chart = read_facade(ground, houses(np.inf), views, left=True, texel_m=0.05)
    assert chart is not None
    filled = invented_facades(chart, label=3, sh_degree=1).filled
    rows, columns = np.nonzero(filled)
    hidden = chart.world(rows[:1], columns[:1])[0]
    seen = chart.world(*(index[:1] for index in np.nonzero(chart.known)))[0]
    places = np.array([hidden, hidden - [0, 0.3, 0], hidden - [0, 2.0, 0], hidden - [0, 0, 3.0], seen, [-50, 0, 0]])
    count = len(places)
    left = surfels_from_points(
        places, np.zeros((count, 3), np.uint8), np.zeros(count, np.int64), np.zeros((count, 3)), np.full(count, 0.1)
    )
    assert replaced_by(chart, filled, left).tolist() == [True, True, False, False, False, False]


def test_behind_a_lorry_the_facade_goes_on_to_its_eaves() -> None:
    """Nothing is seen of the second half of a row of houses 7 m high. Behind a car, what is seen over it is no house, and none is
    put there."""
    ground, cameras = street(np.inf)
    lorry = np.array([[13.0, 2.2, 0.0], [19.0, 4.8, 6.0]])
    views = [FacadeView(c, *view(c, lorry)) for c in cameras[:3]]
    chart = read_facade(ground, houses(np.inf, 0.0, 15.0), views, left=True, texel_m=0.1)
    assert chart is not None
    found = invented_facades(chart, label=3, sh_degree=1)
    assert found.walls is not None and found.open is not None
    places, above = (p.means.double().numpy() for p in (found.walls, found.open))
    behind = places[:, 0] > 17
    assert np.abs(places[:, 1] - FACADE_T).max() < 0.2
    assert places[behind, 0].max() > 22 and 6.5 < places[behind, 2].max() < 7.3
    assert above[:, 2].min() > 6.7 and above[:, 2].max() > 7.5
    views = [FacadeView(c, *view(c, lorry * (1, 1, 0.25))) for c in cameras[:3]]
    chart = read_facade(ground, houses(np.inf, 0.0, 15.0), views, left=True, texel_m=0.1)
    assert chart is not None
    assert not np.isfinite(chart.offset[chart.s_start + 0.1 * np.arange(len(chart.offset)) > 17]).any()


def test_where_some_frame_looks_past_the_place_no_facade_goes_on() -> None:
    """Behind the lorry is a gap: earlier frames show, low down, what lies far behind it."""
    ground, cameras = street(np.inf)
    lorry = np.array([[13.0, 2.2, 0.0], [19.0, 4.8, 6.0]])

    def views(*, past: bool) -> list[FacadeView]:
        """All see the lorry; with ``past``, so does one that drove before the lorry came, and saw a meadow beyond the houses."""
        found = [FacadeView(c, *view(c, lorry)) for c in cameras[:3]]
        image, wall, sky, depth, hidden = view(cameras[0], lorry - (0, 50, 0))
        beyond = wall & (cameras[0].unproject(np.where(wall, depth, 1.0))[..., 0] > 15)
        depth[beyond], wall[beyond] = FAR, False
        return [*found, FacadeView(cameras[0], image, wall, sky, depth, hidden)] if past else found

    for past in (False, True):
        chart = read_facade(ground, houses(np.inf, 0.0, 15.0), views(past=past), left=True, texel_m=0.1)
        assert chart is not None
        carried = np.isfinite(chart.offset[chart.s_start + 0.1 * np.arange(len(chart.offset)) > 17]).any()
        assert carried != past
