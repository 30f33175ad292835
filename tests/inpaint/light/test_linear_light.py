"""Light is a factor of linear light: in the dark end of codes, too, and whatever the sensor cut off."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.inpaint.sunny_street import sunny_chart
from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, RELIT, StreetChart
from unveil_core.inpaint.fill.chart_fill import fill_chart
from unveil_core.inpaint.frames.local_light import in_local_light
from unveil_core.inpaint.light.shade import Light, Shade, read_shade
from unveil_core.inpaint.light.sun import Sun

TINT = np.array([1.0, 0.93, 0.82])
"""Of asphalt that has yellowed."""
SKY = np.array([0.35, 0.5, 0.7])
"""Light in the shade of a clear sky, by that in the sun."""
EVEN = np.full(3, 0.5)


def other_light(color: np.ndarray, factor: np.ndarray) -> np.ndarray:
    return srgb_of_linear(linear_of_srgb(color) * factor)


def median_of_offsets(color: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """See ``shade.Profile``."""
    return np.repeat(np.nanmedian(np.where(usable[..., None], color, np.nan), axis=0)[None], len(color), axis=0)


def dark_asphalt(factor: np.ndarray, *, stony: bool = False) -> tuple[StreetChart, np.ndarray, np.ndarray]:
    """A street whose lateral offsets have the codes 5 to 60 of 255, or whose stones have, of which 9 m in the middle lie in shadow;
    its colours (A, B, 3) without that, and where it lies (A, B)."""
    chart = sunny_chart(None)[0]
    rows, columns = chart.source.shape
    code = np.repeat(np.linspace(5, 60, columns)[None], rows, axis=0)
    if stony:
        code = 12 + np.random.default_rng(0).permuted(code) / 2
    color = code[..., None] * TINT / 255
    shadow = np.zeros((rows, columns), bool)
    shadow[200:380] = True
    seen = np.where(shadow[..., None], other_light(color, factor), color)
    # What is dark for its kind is told within a label.
    label = np.repeat((np.arange(columns) // 20).astype(np.int16)[None], rows, axis=0)
    chart = replace(chart, color=seen.astype(np.float32), source=np.full_like(chart.source, OBSERVED), label=label)
    return chart, color, shadow


def without_shadow(factor: np.ndarray, *, stony: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Colours (N, 3) inside the shadow when it goes with a lorry, and as they are without it."""
    chart, color, shadow = dark_asphalt(factor, stony=stony)
    lorry = np.zeros_like(shadow)
    lorry[280:300, 130:150] = True
    light = Light(Sun(np.array([0.0, 0.7, 0.7]), 1.0, 0.0, 45.0), np.zeros_like(shadow), shadow)
    filled = fill_chart(chart, lorry, light=light)
    inner = np.zeros_like(shadow)
    inner[215:365, 8:-8] = True
    inner &= filled.source == RELIT
    assert inner.sum() > 20_000
    return filled.color[inner], color[inner]


@pytest.mark.parametrize("factor", [EVEN, SKY])
def test_a_ramp_of_dark_codes_comes_back_from_its_shade(factor: np.ndarray) -> None:
    chart, color, shadow = dark_asphalt(factor)
    shade = read_shade(chart.color, ~np.zeros_like(shadow), shadow, median_of_offsets, texels_per_m=20.0)
    assert np.abs(shade.ratio - factor).max() < 0.01
    assert (shade.dark == shadow).mean() > 0.99
    back = other_light(chart.color[shadow], 1 / shade.ratio)
    assert np.abs(back - color[shadow]).max() * 255 < 1


@pytest.mark.parametrize("factor", [EVEN, SKY])
def test_a_shadow_is_taken_from_dark_asphalt_level_by_level(factor: np.ndarray) -> None:
    found, true = without_shadow(factor, stony=True)
    code = np.round(true[:, 0] * 255)
    for level in range(15, 42):
        of_level = code == level
        assert np.abs(found[of_level] - true[of_level]).mean() * 255 < 1, level


def test_dark_asphalt_keeps_its_hue() -> None:
    found, true = (
        cv2.cvtColor(c[None].astype(np.float32), cv2.COLOR_RGB2Lab)[0] for c in without_shadow(SKY, stony=True)
    )
    assert np.hypot(*(found - true)[:, 1:].T).max() < 1


def test_dark_asphalt_that_was_seen_in_the_sun_is_invented_in_the_shade_that_stays() -> None:
    chart, color, shadow = dark_asphalt(SKY)
    car = np.zeros_like(shadow)
    car[190:390, 30:70] = True
    hidden = replace(
        chart,
        color=np.where(car[..., None], 0, chart.color).astype(np.float32),
        source=np.where(car, OUTSIDE, OBSERVED).astype(np.uint8),
    )
    light = Light(Sun(np.array([0.0, 0.7, 0.7]), 1.0, 0.0, 45.0), shadow, np.zeros_like(shadow))
    filled = fill_chart(hidden, car, light=light)
    assert (filled.source[car] == INVENTED).all()
    inner = np.s_[215:365, 30:70]
    assert np.abs(filled.color - chart.color)[inner].mean(axis=(0, 2)).max() * 255 < 1


def test_ground_that_the_sensor_cut_off_tells_nothing_of_the_shade() -> None:
    """Concrete at most offsets is so bright in the sun that it is white, and in shade it is not."""
    shadow = np.zeros((400, 200), bool)
    shadow[150:250] = True
    light = np.full((400, 200, 3), 0.2)
    light[:, :130] = 1.6
    light[shadow] *= EVEN

    def ratio(first: int) -> np.ndarray:
        color = srgb_of_linear(np.minimum(light[:, first:], 1)).astype(np.float32)
        seen = np.ones(color.shape[:2], bool)
        found: Shade = read_shade(color, seen, shadow[:, first:], median_of_offsets, texels_per_m=20.0)
        return found.ratio

    np.testing.assert_allclose(ratio(0), ratio(130), atol=0.01)


def test_a_ring_that_the_sensor_cut_off_tells_nothing_of_the_frames_light() -> None:
    """Most of the ground around the hole is a pavement that is white in this frame."""
    shape = (96, 144)
    chart = np.full((*shape, 3), 0.4, np.float32)
    chart[:, :80] = 0.92
    photograph = np.round(255 * srgb_of_linear(np.minimum(linear_of_srgb(chart) * 2, 1))).astype(np.uint8)
    ring = np.zeros(shape, bool)
    ring[20:76, 30:110] = True
    ring[32:64, 42:98] = False
    found = in_local_light(photograph, chart, np.ones(shape, bool), ring)
    wanted = srgb_of_linear(linear_of_srgb(np.array(0.4)) * 2)
    assert np.abs(found[34:62, 84:96] - wanted).max() * 255 < 2
