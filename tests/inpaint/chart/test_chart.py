"""The street chart on a painted street with a known truth: reading, shadows, filling."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.ground.test_street import drive_on_circle, street_points, true_street
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.ground.street_fit import fit_street_heights
from unveil_core.inpaint.chart.street_chart import (
    INVENTED,
    OBSERVED,
    OUTSIDE,
    RELIT,
    StreetChart,
    read_chart,
    usable_pixels,
)
from unveil_core.inpaint.fill.chart_fill import fill_chart
from unveil_core.inpaint.frames.new_ground import seed_ground, texels_in_pixels
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.classes import LabelSet

RADIUS = 60.0


def paint(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """True colours: asphalt, an edge line at -2.2 m, a sidewalk beyond the kerb at 4 m with joints every 60 cm."""
    grain = 0.03 * np.sin(13 * s + 7 * t) * np.cos(11 * t - 5 * s)
    color = np.repeat((0.35 + grain)[..., None], 3, axis=-1)
    color[np.abs(t + 2.2) < 0.1] = 0.85
    sidewalk = np.abs(t) > 4
    color[sidewalk] = np.array([0.6, 0.57, 0.52])
    color[sidewalk & (np.abs((s / 0.6) % 1) < 0.08)] = 0.42
    return color


def in_car(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    return (s > 9) & (s < 13.5) & (t < -1.6) & (t > -3.5)


def in_shadow(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    return (s > 9) & (s < 13.5) & (t >= -1.6) & (t < -0.6)


def painted_street() -> tuple[Ground, list[Camera], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Its ground, cameras, images, labels and what of each image shows ground."""
    cameras = [c.resized(216, 144) for c in drive_on_circle(RADIUS, 0.0)]
    path = fit_path(cameras)
    ground = fit_street_heights(path, street_points(RADIUS, 0.0))
    images, labels, usable = [], [], []
    for camera in cameras:
        depth, at = ground.intersect(camera, camera.rays().reshape(-1, 3))
        s, t = at[:, 0], at[:, 1]
        color = paint(s, t)
        color[in_shadow(s, t)] *= 0.5
        hit = np.isfinite(depth)
        color[~hit] = 0.7
        color[in_car(s, t) & hit] = (0.8, 0.1, 0.1)
        shape = (camera.height, camera.width)
        images.append((color.reshape(*shape, 3) * 255).round().astype(np.uint8))
        labels.append(np.where(np.abs(t) > 4, 1, 0).reshape(shape))
        usable.append((hit & ~in_car(s, t)).reshape(shape))
        usable[-1] = cv2.erode(usable[-1].astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    return ground, cameras, images, labels, usable


@pytest.fixture(scope="module")
def street() -> tuple[Ground, list[Camera], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    return painted_street()


@pytest.fixture(scope="module")
def chart(street) -> StreetChart:  # type: ignore[no-untyped-def]
    ground, cameras, images, labels, usable = street
    return read_chart(ground, cameras, images, labels, usable)


def coordinates(chart: StreetChart) -> tuple[np.ndarray, np.ndarray]:
    s, t = chart.coordinates()
    return np.meshgrid(s, t, indexing="ij")


def test_reading_returns_the_paint(chart: StreetChart) -> None:
    s, t = coordinates(chart)
    clear = (chart.source == OBSERVED) & (s > 3) & (s < 24) & (np.abs(t) < 3.6) & ~in_shadow(s, t)
    clear &= (np.abs(np.abs(t + 2.2) - 0.1) > 0.08) & ~((s > 8.8) & (s < 13.7) & (t < -0.4))
    error = np.abs(chart.color - paint(s, t)).mean(axis=-1)[clear]
    assert clear.sum() > 20_000
    assert np.median(error) < 0.02


def filled(chart: StreetChart, **settings: float) -> StreetChart:
    s, t = coordinates(chart)
    return fill_chart(chart, in_car(s, t), **settings)


def test_paint_continues_through_the_hole(chart: StreetChart) -> None:
    result = filled(chart)
    s, t = coordinates(chart)
    hole = (s > 9.3) & (s < 13.2) & (t < -1.9) & (t > -3.2)
    assert (result.source[hole] == INVENTED).all()
    line = hole & (np.abs(t + 2.2) < 0.06)
    asphalt = hole & (np.abs(t + 2.2) > 0.25)
    assert abs(float(result.color[line].mean()) - 0.85) < 0.08
    assert abs(float(result.color[asphalt].mean()) - 0.35) < 0.03
    # texture, not a flat smear
    assert float(result.color[asphalt].std()) > 0.005


def test_shadow_of_what_went_goes_with_it(chart: StreetChart) -> None:
    s, t = coordinates(chart)
    core = (s > 9.5) & (s < 13) & (t > -1.4) & (t < -0.8) & (chart.source == OBSERVED)
    assert core.sum() > 200
    before = float(np.abs(chart.color[core] - paint(s, t)[core]).mean())
    result = filled(chart)
    after = float(np.abs(result.color[core] - paint(s, t)[core]).mean())
    assert (result.source[core] == RELIT).mean() > 0.9
    assert after < before / 4
    kept = filled(chart, shadow_reach_m=0.0)
    assert np.array_equal(kept.color[core], chart.color[core])


def test_world_lies_on_the_circle(chart: StreetChart) -> None:
    rows, columns = np.array([300, 400]), np.array([50, 120])
    world = chart.world(rows, columns)
    s, t = chart.coordinates()
    expected = true_street(RADIUS, s[rows], t[columns])
    assert np.abs(world[:, :2] - expected).max() < 0.5


def test_all_invented_ground_that_a_frame_must_show_gets_surfels(street, chart: StreetChart) -> None:  # type: ignore[no-untyped-def]
    ground, cameras, *_ = street
    full, camera = replace(chart, source=np.where(chart.source == OUTSIDE, INVENTED, chart.source)), cameras[3]
    depth, place = ground.intersect(camera, camera.rays().reshape(-1, 3))
    row, column, inside = full.index_of(place)
    invented = np.isfinite(depth) & (depth < 15) & inside & (full.source[row, column] == INVENTED)
    mask = invented.reshape(camera.height, camera.width)
    assert mask.sum() > 200
    region = texels_in_pixels(full, [camera, cameras[0]], [mask, np.zeros_like(mask)])
    seeds = seed_ground(full, region, [], spacing=0.08, sh_degree=0, default_label=0)
    alpha = render_numpy(seeds, camera, near=0.1, far=100.0)["alpha"]
    # The mask's border is not solid.
    assert (alpha[cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0] > 0.9).all()
    assert not texels_in_pixels(full, [camera], [np.zeros_like(mask)]).any()
    assert not (region & (full.source != INVENTED)).any()


def test_without_labels_ground_is_what_nothing_stands_before(
    street: tuple[Ground, list[Camera], list[np.ndarray], list[np.ndarray], list[np.ndarray]],
) -> None:
    ground, (camera, *_), *_ = street
    shape = camera.height, camera.width
    met = ground.intersect(camera, camera.rays().reshape(-1, 3))[0].reshape(shape)
    on_ground, third = np.isfinite(met), camera.width // 3
    depth = 1.02 * met  # a road that few points hold lies metres too deep, or nothing is reconstructed there
    depth[:, :third] = 3 * met[:, :third]
    depth[: camera.height * 3 // 4, :third] = np.nan
    depth[:, -third:] = 0.6 * met[:, -third:]  # something stands there
    no_ground = LabelSet(("keep", "remove"), (0, 1))
    labels, hidden = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=bool)
    usable = usable_pixels(ground, camera, labels, no_ground, hidden, depth)
    assert np.array_equal(usable[:, :-third], on_ground[:, :-third]) and on_ground[:, :third].any()
    assert not usable[:, -third:].any()
