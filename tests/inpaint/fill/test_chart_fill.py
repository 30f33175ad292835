"""Filling of the chart: shadows that go with their objects, and ground that nobody saw."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tests.inpaint.sunny_street import sunny_chart
from unveil_core.base.srgb import relight
from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.chart.street_chart import OBSERVED, OUTSIDE, StreetChart
from unveil_core.inpaint.fill.chart_fill import fill_chart
from unveil_core.inpaint.light.shade import Light
from unveil_core.inpaint.light.sun import Sun


def as_read(chart: StreetChart, color: Float32, hidden: Mask) -> StreetChart:
    """The chart of a street of that colour, read from 5 m away where nothing is ``hidden``."""
    return replace(
        chart,
        color=np.where(hidden[..., None], 0, color).astype(np.float32),
        source=np.where(hidden, OUTSIDE, OBSERVED).astype(np.uint8),
        nearest=np.full_like(chart.nearest, 5.0),
    )


def test_black_shadow_far_from_what_is_known_of_its_object_is_replaced() -> None:
    """The cab of a lorry is tall, and the asphalt before it black; of where it stands only its middle is known."""
    chart = sunny_chart(None)[0]
    per_m = 1 / chart.texel
    street = np.random.default_rng(0).normal(0.5, 0.01, (*chart.source.shape, 1)).repeat(3, axis=2).astype(np.float32)
    lorry, gone, black = (np.zeros(chart.source.shape, dtype=bool) for _ in range(3))
    aside = slice(int(6 * per_m), int(8.5 * per_m))
    lorry[int(16 * per_m) : int(20 * per_m), aside] = True
    gone[int(10 * per_m) : int(20 * per_m), aside] = True
    black[int(12 * per_m) : int(14 * per_m), aside] = True
    ratio = np.where(black[..., None], 0.03, np.where(gone[..., None], np.array([0.13, 0.17, 0.27]), 1))
    chart = as_read(chart, relight(street, ratio), lorry)
    light = Light(Sun(np.array([0.0, 0.7, 0.7]), 1.0, 0.0, 45.0), np.zeros_like(gone), gone)
    filled = fill_chart(chart, lorry, light=light)
    assert filled.replaced[black].mean() > 0.95  # else frames would show their own pixels
    assert abs(float(filled.color[black].mean()) - 0.5) < 0.03


def test_in_the_shade_no_dark_patch_stays_beside_what_goes() -> None:
    """A lorry in the shade of a house darkens the ground around it to a twelfth of that shade's light."""
    chart = sunny_chart(None)[0]
    per_m = 1 / chart.texel
    street = np.random.default_rng(0).normal(0.6, 0.01, (*chart.source.shape, 1)).repeat(3, axis=2).astype(np.float32)
    lorry, house = np.zeros(chart.source.shape, dtype=bool), np.zeros(chart.source.shape, dtype=bool)
    lorry[int(12 * per_m) : int(18 * per_m), int(6 * per_m) : int(8.5 * per_m)] = True
    house[int(6 * per_m) :] = True
    shade = np.where(house[..., None], np.array([0.17, 0.22, 0.32], dtype=np.float32), 1)
    away = cv2.distanceTransform((~lorry).astype(np.uint8), cv2.DIST_L2, 5) / per_m
    in_shade = relight(street, shade)
    seen = relight(in_shade, np.clip(0.33 + 0.67 * away / 0.8, 0, 1)[..., None] ** 2.2)
    chart = as_read(chart, seen, lorry)
    light = Light(Sun(np.array([0.0, 0.7, 0.7]), 1.0, 0.0, 45.0), house, np.zeros_like(house))
    filled = fill_chart(chart, lorry, light=light).color
    level = filled.mean(axis=2) / in_shade.mean(axis=2)
    beside = (away > 0) & (away < 0.3)
    assert abs(np.median(level[beside]) - 1) < 0.1
    assert np.percentile(level[away < 0.8], 5) > 0.65


def test_the_sidewalk_before_a_corner_is_not_continued_into_the_next_street() -> None:
    """Before the corner a sidewalk lies 3 m from the path; after it a parked row stands there, and nobody saw the ground."""
    chart = sunny_chart(None)[0]
    s, t = chart.coordinates()
    path = chart.ground.path
    nodes = path.start + path.step * np.arange(len(path.heading))
    turned = path.heading + np.radians(80) * np.clip((nodes - 8) / 6, 0, 1)
    street = np.random.default_rng(0).normal(0.3, 0.01, (*chart.source.shape, 1)).repeat(3, axis=2).astype(np.float32)
    street[np.ix_(s < 8, t > 3)] += 0.4
    hidden = np.zeros(chart.source.shape, dtype=bool)
    hidden[np.ix_(s > 8, t > 3)] = True
    level = []
    for way in (replace(path, heading=turned), path):
        given = as_read(replace(chart, ground=replace(chart.ground, path=way)), street, hidden)
        filled = fill_chart(given, np.zeros_like(hidden)).color.mean(axis=2)
        level.append(float(filled[np.ix_((s > 16) & (s < 24), (t > 4) & (t < 5))].mean()))
    behind_the_corner, straight_on = level
    assert abs(behind_the_corner - 0.3) < 0.03
    assert straight_on > behind_the_corner + 0.05


def test_no_dark_edge_stays_where_a_car_under_an_even_sky_went() -> None:
    """Beside its silhouette pixels mix the ground with the car's underside: dark, but not black."""
    chart = sunny_chart(None)[0]
    per_m = 1 / chart.texel
    street = np.random.default_rng(0).normal(0.5, 0.005, (*chart.source.shape, 1)).repeat(3, axis=2).astype(np.float32)
    car = np.zeros(chart.source.shape, dtype=bool)
    car[int(12 * per_m) : int(16 * per_m), int(6 * per_m) : int(8 * per_m)] = True
    away = cv2.distanceTransform((~car).astype(np.uint8), cv2.DIST_L2, 5) / per_m
    light = np.where(away < 0.12, 0.09, np.clip(0.6 + 0.4 * away / 0.7, 0, 1) ** 2.2).astype(np.float32)
    filled = fill_chart(as_read(chart, relight(street, light[..., None]), car), car)
    level = filled.color.mean(axis=2) / street.mean(axis=2)
    assert level[away < 0.3].min() > 0.85
    assert filled.replaced[(away > 0) & (away < 0.1)].mean() > 0.95


def test_a_worn_line_is_not_laid_down_as_texture() -> None:
    chart = sunny_chart(None)[0]
    per_m = 1 / chart.texel
    street = np.random.default_rng(0).normal(0.5, 0.004, (*chart.source.shape, 1)).repeat(3, axis=2).astype(np.float32)
    lane, car = slice(int(6 * per_m), int(8 * per_m)), np.zeros(chart.source.shape, dtype=bool)
    car[int(10 * per_m) : int(26 * per_m), lane] = True
    car[: int(7 * per_m), lane] = True
    # Bent, as where the ground's height is not known to centimetres, so that no line is found that could go on.
    for k, column in enumerate(range(lane.start, lane.stop)):
        bend = round(0.3 * per_m * np.sin(k / 4))
        street[int(8 * per_m) + bend : int(8.25 * per_m) + bend, column] += 0.045
    filled = fill_chart(as_read(chart, street, car), car).color[int(11 * per_m) : int(25 * per_m), lane].mean(axis=2)
    assert np.abs(cv2.blur(filled, (3, 3)) - 0.5).max() < 0.02
    assert filled.std() > 0.001
