"""The foot of walls beside a street, row by row: as if each row looked at all points."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import median_filter

from unveil_core.base.types import Float64
from unveil_core.ground import street_fit


def by_looking_at_all(side: Float64, fallback: Float64) -> Float64:
    row = np.round(side[:, 0] / street_fit.S_CELL_M)
    near = [side[np.abs(row - r) <= 3, 1] for r in range(len(fallback))]
    known = {r: max(fallback[r], np.percentile(t, 15)) for r, t in enumerate(near) if len(t) >= 15}
    if not known:
        return fallback
    limit = [known[min(known, key=lambda k, r=r: abs(k - r))] for r in range(len(fallback))]  # type: ignore[misc]
    return median_filter(np.maximum(limit, fallback), 5, mode="nearest")


@given(st.integers(0, 2**32 - 1), st.integers(0, 300), st.integers(1, 60), st.integers(0, 2))
def test_walls_are_where_the_points_around_a_row_are(seed: int, points: int, rows: int, crowded: int) -> None:
    generator = np.random.default_rng(seed)
    along = generator.uniform(-5, 1.1 * rows * street_fit.S_CELL_M, points) * generator.random(points) ** crowded
    side, fallback = np.stack([along, generator.uniform(2, 9, points)], axis=1), generator.uniform(1, 5, rows)
    np.testing.assert_array_equal(street_fit._wall_limit(side, 0.0, fallback), by_looking_at_all(side, fallback))
