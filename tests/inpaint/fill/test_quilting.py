"""Quilting a hole in a texture from other rows of the same columns."""

from __future__ import annotations

import numpy as np

from unveil_core.inpaint.fill.quilting import quilt

ROWS, COLUMNS, PERIOD = 240, 40, 48


def texture() -> np.ndarray:
    """(A, B, 3) noise that repeats along the rows."""
    noise = np.random.default_rng(0).normal(0, 0.05, (PERIOD, COLUMNS, 3))
    return np.tile(noise, (ROWS // PERIOD, 1, 1)).astype(np.float32)


def test_a_texture_that_repeats_is_completed() -> None:
    whole, hole = texture(), np.zeros((ROWS, COLUMNS), dtype=bool)
    hole[100:120, 10:30] = True
    found = quilt(np.where(hole[..., None], 0, whole), ~hole, hole, patch=12, search=100)
    assert np.allclose(found[hole], whole[hole], atol=1e-5)
    assert not found[~hole].any()


def test_without_a_hole_or_a_source_nothing_is_laid_down() -> None:
    whole, nothing = texture(), np.zeros((ROWS, COLUMNS), dtype=bool)
    assert not quilt(whole, ~nothing, nothing, patch=12, search=100).any()
    assert not quilt(whole, nothing, ~nothing, patch=12, search=100).any()
