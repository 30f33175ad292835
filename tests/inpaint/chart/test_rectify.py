"""The wander of the street, found from paint and taken out of its chart."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.inpaint.chart.rectify import Drift, find_drift

PER_M = 25.0


def wavy_street(wander_m: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A chart (A, B, 3) with an edge line and a kerb that wander by so much (A,), and what of it was seen."""
    rng = np.random.default_rng(seed)
    rows, columns = len(wander_m), 320
    across = np.arange(columns)[None] / PER_M - wander_m[:, None]
    color = np.full((rows, columns), 0.4) + rng.normal(0, 0.02, (rows, columns))
    color = np.where(np.abs(across - 3.0) < 0.08, 0.85, color)
    color = np.where(across > 8.0, color + 0.15, color)
    seen = np.ones((rows, columns), dtype=bool)
    for start in range(100, rows - 120, 260):
        seen[start : start + 110, :140] = False
    picture = np.repeat(color[..., None], 3, axis=2).astype(np.float32)
    return np.where(seen[..., None], picture, 0), seen


def test_drift_is_found_to_a_centimetre_or_two() -> None:
    s = np.arange(1400) / PER_M
    wander = 0.12 * np.sin(2 * np.pi * s / 18) + 0.004 * (s - 28)
    color, seen = wavy_street(wander)
    found = find_drift(color, seen, texels_per_m=PER_M).texels / PER_M
    gap = found - wander
    assert np.abs(gap - np.median(gap))[50:-50].mean() < 0.02


def test_medians_are_sharper_once_it_is_out() -> None:
    s = np.arange(1400) / PER_M
    color, seen = wavy_street(0.12 * np.sin(2 * np.pi * s / 18))
    drift = find_drift(color, seen, texels_per_m=PER_M)

    def scatter(picture: np.ndarray, mask: np.ndarray) -> float:
        values = np.where(mask, picture[..., 0], np.nan)[:, 20:-20]
        return float(np.nanmean((values - np.nanmedian(values, axis=0)) ** 2))

    assert scatter(*drift.rectify(color, seen)) < 0.5 * scatter(color, seen)


def test_a_street_without_paint_and_one_that_nobody_saw_have_no_drift() -> None:
    plain = np.full((300, 100, 3), 0.4, dtype=np.float32)
    for seen in (np.ones((300, 100), dtype=bool), np.zeros((300, 100), dtype=bool)):
        drift = find_drift(plain, seen, texels_per_m=PER_M)
        assert not drift.texels.any()
        assert drift.rectify(plain, seen)[0] is plain


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(-8, 8))
def test_unrectify_undoes_rectify(seed: int, shift: float) -> None:
    rng = np.random.default_rng(seed)
    smooth = np.cumsum(rng.normal(0, 0.01, (40, 60, 3)), axis=1).astype(np.float32)
    drift = Drift(np.full(40, shift, dtype=np.float32))
    there, known = drift.rectify(smooth, np.ones((40, 60), dtype=bool))
    back = drift.unrectify(there)
    assert known.all()
    assert np.abs(back - smooth)[:, 10:-10].max() < 0.03


def test_what_was_not_seen_does_not_leak() -> None:
    color = np.full((10, 40, 3), 0.5, dtype=np.float32)
    seen = np.ones((10, 40), dtype=bool)
    seen[:, 20:30] = False
    color[:, 20:30] = 9.0
    moved, known = Drift(np.full(10, 2.4, dtype=np.float32)).rectify(color, seen)
    assert np.allclose(moved[known], 0.5)
    assert known[0, :17].all() and not known[0, 19:26].any()
