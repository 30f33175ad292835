"""Filtered look-up in a chart, against the definition in float64."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.inpaint.chart.sampling import LONGEST_TEXELS, TAPS, blur_levels, sample_levels


def bilinear(picture: np.ndarray, row: float, column: float) -> np.ndarray:
    rows, columns = picture.shape[:2]
    row, column = np.clip(row, 0, rows - 1.001), np.clip(column, 0, columns - 1.001)
    i, j = int(row), int(column)
    u, v = row - i, column - j
    return (1 - u) * ((1 - v) * picture[i, j] + v * picture[i, j + 1]) + u * (
        (1 - v) * picture[i + 1, j] + v * picture[i + 1, j + 1]
    )


def by_definition(levels: list[np.ndarray], place: np.ndarray, footprint: np.ndarray, across: float) -> np.ndarray:
    """One place: the mean of the taps, each between the two blur levels next to its width."""
    level = min(max(np.log2(max(across, 1.0)), 0.0), len(levels) - 1.001)
    blend = level - int(level)
    reach = footprint * min(1.0, LONGEST_TEXELS / max(np.hypot(*footprint), 1e-12))
    total = np.zeros(levels[0].shape[2])
    for k in range(TAPS):
        at = place + ((k + 0.5) / TAPS - 0.5) * reach
        for picture, weight in ((levels[int(level)], 1 - blend), (levels[int(level) + 1], blend)):
            total += weight * bilinear(picture.astype(np.float64), *at) / TAPS
    return total


@given(st.integers(0, 2**32 - 1))
def test_taps_and_levels_are_those_of_the_definition(seed: int) -> None:
    """Beyond the borders, with footprints longer than the chart, and from finer than a texel to the widest blur."""
    generator = np.random.default_rng(seed)
    levels = blur_levels(generator.uniform(0, 1, (40, 25, 2)).astype(np.float32))
    place = generator.uniform(-5, 45, (12, 2))
    footprint, across = generator.normal(0, 60, (12, 2)), np.exp(generator.uniform(-2, 4, 12))
    found = sample_levels(levels, place, footprint, across)
    expected = [by_definition(levels, p, f, a) for p, f, a in zip(place, footprint, across, strict=True)]
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_a_slope_comes_back_as_it_is() -> None:
    """Blur and taps are symmetric: a linear picture is not changed by them."""
    rows, columns = np.mgrid[:80, :60]
    levels = blur_levels((0.01 * rows + 0.003 * columns)[..., None].astype(np.float32))
    place = np.array([[40.25, 30.5], [37.0, 25.75]])
    found = sample_levels(levels, place, np.array([[9.0, 4.0], [0.0, 0.0]]), np.array([2.5, 0.1]))
    np.testing.assert_allclose(found[:, 0], place @ [0.01, 0.003], atol=1e-5)
