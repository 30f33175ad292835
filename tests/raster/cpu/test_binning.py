"""Surfels by tile: what a plain sort gives, whatever the number of parts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.base.array_pool import Buffers
from unveil_core.base.parallel import threads
from unveil_core.raster.cpu import binning
from unveil_core.raster.cpu.binning import bin_surfels


def plainly(depths: np.ndarray, visible: np.ndarray, boxes: np.ndarray, tiles_x: int) -> list[list[int]]:
    """For each tile its surfels, and where their gradient rows lie, one after the other."""
    lists: dict[int, list[int]] = {}
    area = np.where(visible, (boxes[:, 1] - boxes[:, 0] + 1) * (boxes[:, 3] - boxes[:, 2] + 1), 0)
    start = np.cumsum(area) - area
    for n in np.lexsort((np.arange(len(depths)), depths)):
        if visible[n]:
            row = int(start[n])
            for y in range(boxes[n, 2], boxes[n, 3] + 1):
                for x in range(boxes[n, 0], boxes[n, 1] + 1):
                    lists.setdefault(y * tiles_x + x, []).extend((int(n), row))
                    row += 1
    return [lists.get(t, []) for t in range(max(lists, default=-1) + 1)]


@given(st.integers(0, 2**31), st.integers(0, 400), st.sampled_from([1, 2, 5]))
@settings(max_examples=40, deadline=None)
def test_it_is_what_a_plain_sort_gives_for_any_number_of_parts(seed: int, count: int, parts: int) -> None:
    rng = np.random.default_rng(seed)
    tiles = (int(rng.integers(1, 9)), int(rng.integers(1, 7)))
    # Few different depths: ties, and digits that are all alike.
    depths = rng.choice(np.array([0.1, 0.1000001, 1.0, 3.5, 700.0, 1e30], np.float32), count)
    visible = rng.integers(0, 2, count).astype(np.uint8)
    low = np.stack([rng.integers(0, t, count) for t in tiles], axis=1)
    high = np.stack([np.minimum(low[:, k] + rng.integers(0, 3, count), tiles[k] - 1) for k in (0, 1)], axis=1)
    boxes = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1).astype(np.int16)
    with pytest.MonkeyPatch.context() as patch, threads(parts):
        patch.setattr(binning, "LEAST_SORTED", 7)
        patch.setattr(binning, "LEAST_LISTED", 5)
        bins = bin_surfels(depths.view(np.uint32), visible, boxes, tiles, Buffers())
    expected = plainly(depths, visible, boxes, tiles[0])
    assert len(bins.offsets) == tiles[0] * tiles[1] + 1
    for tile, wanted in enumerate(expected):
        part = slice(bins.offsets[tile], bins.offsets[tile + 1])
        assert np.stack([bins.ids[part], bins.place[part]], axis=1).ravel().tolist() == wanted
    assert bins.offsets[-1] == sum(map(len, expected)) // 2 == bins.surfel_start[-1]
