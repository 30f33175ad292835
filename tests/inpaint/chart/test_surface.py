"""What the ground and a wall have in common: places and texels that belong together, looks, and surfels that lie on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.ground.test_street import drive_on_circle
from tests.inpaint.facade.test_continued import FACADE_T, street
from tests.inpaint.sunny_street import sunny_chart
from unveil_core.inpaint.chart.surface import Surface, shown_places, surfels_on
from unveil_core.inpaint.facade.facade_chart import REPLACED_M, empty_chart
from unveil_core.raster import render

TEXEL_M = 0.25


def ground() -> tuple[Surface, tuple[int, int]]:
    chart, *_ = sunny_chart(None)
    return chart, chart.source.shape


def wall(radius: float) -> tuple[Surface, tuple[int, int]]:
    path_ground, _ = street(radius)
    s = np.arange(0.0, 25.0, TEXEL_M)
    chart = empty_chart(path_ground, s, np.full(len(s), FACADE_T), 5.0)
    return chart, chart.known.shape


@pytest.fixture(params=["ground", "straight wall", "wall in a bend"])
def surface(request: pytest.FixtureRequest) -> tuple[Surface, tuple[int, int]]:
    return ground() if request.param == "ground" else wall(np.inf if "straight" in request.param else 60.0)


def some_texels(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(1)
    return generator.integers(2, shape[0] - 2, 300), generator.integers(2, shape[1] - 2, 300)


def path_of(surface: Surface):  # type: ignore[no-untyped-def]
    return surface.ground.path  # type: ignore[attr-defined]


def test_a_texels_place_lies_in_that_texel(surface: tuple[Surface, tuple[int, int]]) -> None:
    chart, shape = surface
    rows, columns = some_texels(shape)
    found = chart.index_of(path_of(chart).to_street(chart.world(rows, columns)))
    assert np.array_equal(found[0], rows) and np.array_equal(found[1], columns) and found[2].all()


def test_normals_are_unit_and_stand_on_the_surface(surface: tuple[Surface, tuple[int, int]]) -> None:
    chart, shape = surface
    rows, columns = some_texels(shape)
    normal, here = chart.normal(rows, columns), chart.world(rows, columns)
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-9
    for beside in (chart.world(rows + 1, columns), chart.world(rows, columns + 1)):
        along = (beside - here) / np.linalg.norm(beside - here, axis=1, keepdims=True)
        assert np.abs((along * normal).sum(axis=1)).max() < 0.05


def test_what_is_far_from_a_wall_does_not_lie_on_it() -> None:
    chart, shape = wall(np.inf)
    rows, columns = some_texels(shape)
    places = path_of(chart).to_street(chart.world(rows, columns))
    for aside, lies in ((0.9 * REPLACED_M, True), (1.1 * REPLACED_M, False)):
        assert (chart.index_of(places - (0, aside, 0))[2] == lies).all()
    assert not chart.index_of(places + (100.0, 0, 0))[2].any()


def test_surfels_lie_on_the_surface_or_behind_it(surface: tuple[Surface, tuple[int, int]]) -> None:
    chart, shape = surface
    rows, columns = some_texels(shape)
    colors = np.random.default_rng(2).uniform(0, 1, (len(rows), 3)).astype(np.float32)
    labels = np.full(len(rows), 3)
    for behind in (0.0, 0.2):
        made = surfels_on(chart, rows, columns, colors, labels, spacing=0.1, sh_degree=0, behind=behind)
        apart = chart.world(rows, columns) - made.means.double().numpy()
        assert np.abs((apart * chart.normal(rows, columns)).sum(axis=1) - behind).max() < 1e-4
        assert (made.labels == 3).all() and np.abs(made.normals().numpy() @ [0, 0, 1]).max() <= 1 + 1e-6


def test_no_light_comes_through_a_slope_or_a_kerb() -> None:
    """Seen from the street level surfels would leave chinks, as the steps of a stair do from below."""
    chart, *_ = sunny_chart(None)
    ground = chart.ground
    across = ground.t_start + ground.t_cell * np.arange(ground.height.shape[1])
    rise = np.where(across > 2, 0.3, 0.0) + 0.4 * np.clip(across + 6, 0, 1.5)
    chart = replace(chart, ground=replace(ground, height=ground.height + rise))
    s, t = chart.coordinates()
    rows, columns = np.nonzero(((s > 3) & (s < 26))[:, None] & (np.abs(t) < 6.5))
    colors, labels = np.full((len(rows), 3), 0.5, np.float32), np.zeros(len(rows), np.int64)
    made = surfels_on(chart, rows, columns, colors, labels, spacing=chart.texel, sh_degree=0)
    camera = drive_on_circle(np.inf, 0.0)[0].resized(300, 200)
    met, street = chart.ground.intersect(camera, camera.rays().reshape(-1, 3))
    within = np.isfinite(met) & (np.abs(street[:, 0] - 14) < 9) & (np.abs(street[:, 1]) < 5.5)
    shown = [
        render(one, camera, ("alpha",)).alpha.numpy().ravel()[within]  # type: ignore[union-attr]
        for one in (made, replace(made, quats=torch.tensor([[1.0, 0, 0, 0]]).expand(len(made), 4)))
    ]
    assert within.sum() > 2000
    assert shown[0].min() > 0.75 and np.percentile(shown[1], 1) < 0.1


def test_places_are_those_that_a_camera_shows_nearby() -> None:
    path_ground, cameras = street(np.inf)
    s, t = (p.ravel() for p in np.meshgrid(np.arange(0, 25, 0.5), np.arange(-3, 3, 0.5), indexing="ij"))
    world = path_ground.path.to_world(np.stack([s, t, np.zeros_like(s)], axis=1))
    camera = cameras[len(cameras) // 2]
    here = path_ground.path.to_street(camera.centre[None])[0, 0]
    index, pixel, depth = shown_places(world, s, path_ground.path, camera, 8.0, furthest_m=6.0)
    every, pixels, depths = camera.shown(world)
    near = (np.abs(s[every] - here) <= 8.0) & (depths <= 6.0)
    assert len(index) > 20 and np.array_equal(index, every[near])
    assert np.array_equal(pixel, pixels[near]) and np.array_equal(depth, depths[near])
