"""What the ring around a hole tells of a photograph's light is carried into it, as a factor."""

from __future__ import annotations

import numpy as np

from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.inpaint.frames.local_light import in_local_light

SHAPE = (96, 144)
KNOWN = np.ones(SHAPE, bool)


def ring() -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[20:76, 40:104] = True
    mask[32:64, 52:92] = False
    return mask


def brightened(chart: np.ndarray, factor: np.ndarray | float) -> np.ndarray:
    light = np.clip(linear_of_srgb(chart) * factor, 0, 1)
    return np.round(255 * srgb_of_linear(light)).astype(np.uint8)


def test_a_factor_that_changes_smoothly_is_met_inside_and_shade_stays_shade() -> None:
    rng = np.random.default_rng(0)
    chart = (0.45 + rng.normal(0, 0.02, (*SHAPE, 1)) + np.zeros(3)).astype(np.float32)
    chart[40:56, 60:80] *= 0.5  # a shadow in the hole
    factor = np.linspace(0.7, 1.5, SHAPE[1])[None, :, None]
    photograph = brightened(chart, factor)
    found = in_local_light(photograph, chart, KNOWN, ring()) * 255
    hole = np.zeros(SHAPE, bool)
    hole[34:62, 54:90] = True
    assert np.abs(found - photograph)[hole].mean() < 4 < np.abs(chart * 255 - photograph)[hole].mean()
    shadow = np.s_[44:52, 64:76]
    assert np.abs(found[shadow] - photograph[shadow]).mean() < 4


def test_a_few_pixels_that_show_something_else_do_not_tell() -> None:
    chart = np.full((*SHAPE, 3), 0.4, np.float32)
    photograph = brightened(chart, 1.2)
    photograph[20:24, 40:104] = 255
    found = in_local_light(photograph, chart, KNOWN, ring()) * 255
    assert np.abs(found[40:60, 60:84] - float(photograph[80, 10, 0])).max() < 6


def test_too_small_a_ring_changes_nothing() -> None:
    chart = np.full((*SHAPE, 3), 0.4, np.float32)
    few = np.zeros(SHAPE, bool)
    few[0, :3] = True
    assert in_local_light(brightened(chart, 2.0), chart, KNOWN, few) is chart
