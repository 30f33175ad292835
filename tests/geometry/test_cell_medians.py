"""Medians by cell, as if each cell looked at all values."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.geometry.cell_medians import cell_medians


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 4), st.sampled_from([np.inf, 0.3]))
def test_each_cell_has_the_median_of_its_own_if_enough_agree(
    seed: int, count: int, fewest: int, together: float
) -> None:
    generator = np.random.default_rng(seed)
    cells, values = generator.integers(-3, 6, count), generator.normal(0, 0.3, count)
    expected = {}
    for cell in np.unique(cells):
        own = values[cells == cell]
        if len(own) >= fewest and np.subtract(*np.percentile(own, [75, 25])) < together:
            expected[int(cell)] = float(np.median(own))
    found, medians = cell_medians(cells, values, fewest=fewest, together=together)
    assert dict(zip(found.tolist(), medians.tolist(), strict=True)) == expected
