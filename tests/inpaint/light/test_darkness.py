"""Ground that is dark for what it is, on a street that houses shade for longer than a stretch."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from unveil_core.base.srgb import relight
from unveil_core.inpaint.light.darkness import in_the_dark, sunny_exceptions

TEXEL, ROWS, COLUMNS = 0.1, 800, 60


def street(shade: tuple[float, float, float]) -> tuple[SimpleNamespace, np.ndarray]:
    """What of a chart is asked for, 80 m long, of which the last 15 m are lit, and where it is not (A, B)."""
    rng = np.random.default_rng(0)
    color = np.full((ROWS, COLUMNS, 3), 0.6) + rng.normal(0, 0.02, (ROWS, COLUMNS, 3))
    shaded = np.zeros((ROWS, COLUMNS), dtype=bool)
    shaded[:650] = True
    color[shaded] = relight(color[shaded], np.power(shade, 2.2))
    label = np.zeros((ROWS, COLUMNS), dtype=np.int16)
    return SimpleNamespace(color=color.astype(np.float32), label=label, texel=TEXEL), shaded


def test_shade_is_dark_however_far_the_next_sunny_place_is() -> None:
    chart, shaded = street((0.40, 0.46, 0.58))
    dark = in_the_dark(chart, np.ones_like(shaded))  # type: ignore[arg-type]
    assert dark[shaded].mean() > 0.95
    assert dark[~shaded].mean() < 0.05


def test_old_asphalt_of_the_same_hue_is_not_dark() -> None:
    chart, shaded = street((0.46, 0.46, 0.46))
    dark = in_the_dark(chart, np.ones_like(shaded))  # type: ignore[arg-type]
    assert dark[:300].mean() < 0.05


def test_a_street_of_one_brightness_has_no_dark() -> None:
    chart, shaded = street((1.0, 1.0, 1.0))
    chart.color[:] = 0.5
    assert not in_the_dark(chart, np.ones_like(shaded)).any()  # type: ignore[arg-type]


def test_a_few_sunny_places_on_a_street_in_shade_are_exceptions() -> None:
    chart, shaded = street((0.40, 0.46, 0.58))
    everywhere = np.ones_like(shaded)
    found = sunny_exceptions(chart, everywhere)  # type: ignore[arg-type]
    assert found[~shaded].mean() > 0.98
    assert not found[shaded].any()
    # A crossing in the shade is as blue as the asphalt beside it.
    chart.color[100:120] = np.clip(chart.color[100:120] * 2, 0, 1)
    assert not sunny_exceptions(chart, everywhere)[shaded].any()  # type: ignore[arg-type]


def test_where_most_lies_in_the_sun_nothing_is_an_exception() -> None:
    chart, shaded = street((0.40, 0.46, 0.58))
    last = np.zeros_like(shaded)
    last[550:] = True
    assert not sunny_exceptions(chart, last)[last].any()  # type: ignore[arg-type]
