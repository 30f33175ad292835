"""Rows of a facade compared with shifted ones, against the formula in float64."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.base.parallel import in_parallel
from unveil_core.inpaint.facade.shift_kernels import compare_rows

DIFFERENT = 0.3


@given(st.integers(1, 12), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_rows_are_compared_as_written(rows: int, columns: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    color = generator.random((rows, columns, 3), dtype=np.float32)
    wall = generator.random((rows, 3), dtype=np.float32)
    known = generator.random((rows, columns)) < 0.6
    held = known & (generator.random((rows, columns)) < 0.8)
    worth = generator.choice(np.array([0, 0.3, 1], np.float32), (rows, columns))
    context = (known * generator.integers(0, 7, (rows, columns))).astype(np.float32)
    shifts = np.array([d for d in range(-rows, rows + 1) if d != 0])
    at = np.flatnonzero(generator.random(rows) < 0.7)
    found = np.full((4, len(at), len(shifts)), np.nan, dtype=np.float32)
    in_parallel(compare_rows, len(at), 2, at, shifts, color, wall, context, known, held, worth, DIFFERENT, *found)
    expected = np.zeros(found.shape)
    for r, i in enumerate(at):
        for k, j in enumerate(i + shifts):
            if not 0 <= j < rows:
                expected[2, r, k] = worth[i].sum()
                continue
            raw, other = color[i].astype(np.float64) - color[j], wall[i].astype(np.float64) - wall[j]
            adapted = np.square(raw - other).sum(axis=1)
            least = np.minimum(np.minimum(np.square(raw).sum(axis=1), adapted), DIFFERENT)
            weight = context[i] * known[j]
            missing = (worth[i] * ~held[j]).sum()
            gap = min(np.square(other).sum(), DIFFERENT)
            expected[:, r, k] = (least * weight).sum(), weight.sum(), missing, gap
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)
