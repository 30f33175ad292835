"""Paint in the shade of a removed object, and asphalt beside a line that drifts: luma alone takes each for the other."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.inpaint.light.relight import relighting_gain
from unveil_core.inpaint.light.shade import Shade, read_shade

PER_M, ROWS, COLUMNS = 20.0, 600, 160
ASPHALT, WHITE = np.array([0.42, 0.42, 0.43]), np.array([0.85, 0.85, 0.84])
SKY = np.array([0.40, 0.52, 0.68])
SHADED = np.s_[220:320]
LINE = np.s_[30:34]


def crossing(drift: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """The street (A, B, 3) in the sun and as it is seen: bars of half a metre across 4 m of it, half of them in shade; and an edge
    line that lies ``drift`` texels beside its offset for the first half of the street."""
    rng = np.random.default_rng(0)
    lit = np.repeat(np.repeat(ASPHALT[None, None], ROWS, axis=0), COLUMNS, axis=1)
    for start in range(60, 150, 20):
        lit[270:350, start : start + 10] = WHITE
    lit[:, LINE] = WHITE
    lit[: ROWS // 2, LINE] = ASPHALT
    lit[: ROWS // 2, LINE.start + drift : LINE.stop + drift] = WHITE
    lit = np.clip(lit * (1 + 0.02 * rng.standard_normal((ROWS, COLUMNS, 1))), 0, 1)
    seen = lit.copy()
    seen[SHADED] *= SKY
    return lit.astype(np.float32), seen.astype(np.float32)


def median_of_offset(color: np.ndarray, usable: np.ndarray) -> np.ndarray:
    return np.repeat(np.nanmedian(np.where(usable[..., None], color, np.nan), axis=0)[None], len(color), axis=0)


def read(seen: np.ndarray) -> Shade:
    expected = np.zeros(seen.shape[:2], dtype=bool)
    expected[SHADED] = True
    return read_shade(seen, np.ones_like(expected), expected, median_of_offset, texels_per_m=PER_M)


def test_white_bars_in_shade_are_dark_and_get_the_light_of_the_ground() -> None:
    lit, seen = crossing()
    shade = read(seen)
    bars, sunny = np.zeros(seen.shape[:2], bool), np.zeros(seen.shape[:2], bool)
    for start in range(60, 150, 20):
        bars[273:317, start + 2 : start + 8], sunny[323:347, start + 2 : start + 8] = True, True
    assert shade.dark[bars].mean() > 0.97 and shade.paint[bars].mean() > 0.97
    assert not shade.dark[sunny].any()
    everything = np.ones(seen.shape[:2], bool)
    args = (seen, shade.lit, everything, shade.dark, shade.dark, shade.dark)
    error = {
        name: np.abs(seen * relighting_gain(*args, paint, per_m=PER_M) - lit)[bars].mean()
        for name, paint in (("told", shade.paint), ("not told", np.zeros_like(everything)))
    }
    assert error["told"] < 0.06 < 0.5 * error["not told"]


@pytest.mark.parametrize("drift", [3, 5])
def test_asphalt_where_a_line_should_be_is_not_in_shade(drift: int) -> None:
    _, seen = crossing(drift)
    dark = read(seen).dark
    assert dark[225:315, 100:140].mean() > 0.95
    lane = np.s_[20:200, LINE.start - 2 : LINE.stop + drift + 2]
    assert dark[lane].mean() < 0.01
