"""The wander of the street, found from paint."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from unveil_core.inpaint.chart import rectify
from unveil_core.inpaint.chart.rectify import LEAST_AGREEMENT, Drift, RowBins, bin_rows, find_drift

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


def drift(color: np.ndarray, seen: np.ndarray) -> Drift:
    return find_drift(RowBins.of_chart(color, seen, texels_per_m=PER_M), len(color), texels_per_m=PER_M)


def test_drift_is_found_to_a_centimetre_or_two() -> None:
    s = np.arange(1400) / PER_M
    wander = 0.12 * np.sin(2 * np.pi * s / 18) + 0.004 * (s - 28)
    color, seen = wavy_street(wander)
    told = drift(color, seen)
    found = told.aside / PER_M
    assert told.agreement > 0.9
    gap = found - wander
    assert np.abs(gap - np.median(gap))[50:-50].mean() < 0.02


def test_a_street_without_paint_and_one_that_nobody_saw_have_no_drift() -> None:
    plain = np.full((300, 100, 3), 0.4, dtype=np.float32)
    for seen in (np.ones((300, 100), dtype=bool), np.zeros((300, 100), dtype=bool)):
        told = drift(plain, seen)
        assert not told.aside.any()
        assert told.agreement == 0


def slabs(degrees: float) -> np.ndarray:
    """A chart (A, B, 3) of slabs whose joints lie so aslant."""
    rows, columns = np.indices((1400, 320)) / PER_M
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    u, v = rows * c + columns * s, columns * c - rows * s
    grey = np.where(((u / 0.8) % 1 < 0.12) | ((v / 0.8) % 1 < 0.12), 0.46, 0.62)
    grey = grey + np.random.default_rng(0).normal(0, 0.02, grey.shape)
    return np.repeat(grey[..., None], 3, axis=2).astype(np.float32)


def test_slabs_agree_only_where_their_joints_run_along_the_street() -> None:
    seen = np.ones((1400, 320), dtype=bool)
    assert drift(slabs(0.0), seen).agreement > 0.9
    for degrees in (10.0, 30.0):
        assert drift(slabs(degrees), seen).agreement < LEAST_AGREEMENT


def test_grain_moves_no_street(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some shifts always fit it a little better than none."""
    rng, moved = np.random.default_rng(0), 0
    for _ in range(4):
        grain = np.clip(0.4 + cv2.GaussianBlur(rng.normal(0, 0.7, (2500, 320)), (0, 0), 2), 0.05, 1)
        color, seen = np.repeat(grain[..., None], 3, axis=2).astype(np.float32), np.ones((2500, 320), dtype=bool)
        told = drift(color, seen)
        assert told.agreement < LEAST_AGREEMENT
        assert not told.aside.any()
        with monkeypatch.context() as patch:
            patch.setattr(rectify, "LEAST_AGREEMENT", 0.0)
            moved += bool(drift(color, seen).aside.any())
    assert moved, "the grain would move nothing anyway"


def test_a_street_in_pieces_has_the_bins_of_the_whole() -> None:
    color, seen = wavy_street(np.zeros(703))
    whole = RowBins.of_chart(color, seen, texels_per_m=PER_M)
    cut = 20 * bin_rows(PER_M)
    halves = [RowBins.of_chart(color[part], seen[part], texels_per_m=PER_M) for part in (slice(cut), slice(cut, None))]
    joined = RowBins.joined(halves)
    np.testing.assert_array_equal(joined.lines, whole.lines)
    np.testing.assert_array_equal(joined.shown, whole.shown)
