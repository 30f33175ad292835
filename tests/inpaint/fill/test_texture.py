"""Texture at lateral offsets that nobody saw."""

from __future__ import annotations

import numpy as np

from unveil_core.inpaint.fill.texture import _beside_what_is_known


def test_columns_that_nobody_saw_get_the_texture_beside_them() -> None:
    rng = np.random.default_rng(0)
    texture = rng.normal(0, 0.1, (60, 30, 3)).astype(np.float32)
    wanted = np.zeros((60, 30), dtype=bool)
    wanted[:, 20:] = True  # a sidewalk behind parked cars
    wanted[10:20, 5:8] = True  # under one car: the quilt fills that
    texture[wanted] = 0
    quilted = np.zeros_like(texture)
    quilted[10:20, 5:8] = 0.05
    filled = _beside_what_is_known(quilted, texture, wanted)
    assert np.array_equal(filled[:, :20], quilted[:, :20])
    spread = filled[:, 20:].std(axis=(0, 2))
    assert (spread > 0.05).all()  # every column has grain
    assert not np.allclose(filled[:, 21], filled[:, 22])  # and no column repeats its neighbour
    assert (filled[~wanted] == 0).all()


def test_a_chart_that_was_seen_all_over_stays() -> None:
    texture = np.ones((10, 6, 3), np.float32)
    quilted = np.full_like(texture, 0.5)
    assert np.array_equal(_beside_what_is_known(quilted, texture, np.ones((10, 6), bool)), quilted)
