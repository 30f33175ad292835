"""Memory that is used again, and never while somebody still looks at it."""

from __future__ import annotations

import gc

import numpy as np
import pytest
import torch

from tests.raster.scenes import camera, random_surfels, with_gradients
from unveil_core.base import array_pool
from unveil_core.raster.api import PLANES, render


def address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


def test_named_buffers_grow_and_begin_at_a_cache_line() -> None:
    mine = array_pool.Buffers()
    small = mine.array("a", (10, 3))
    assert address(small) % 64 == 0
    assert address(mine.array("a", (12, 3))) == address(small), "a fifth more is there already"
    large = mine.array("a", (1000, 3))
    assert address(large) != address(small)
    assert address(mine.array("a", (5,))) == address(large)
    assert mine.array("a", (5,), np.int64).dtype == np.int64


def test_lent_memory_comes_back_when_nobody_holds_it() -> None:
    gc.collect()
    array_pool._lender.returned.clear()
    first = array_pool.lend((1000, 7))
    place = address(first)
    assert place % 64 == 0
    other = array_pool.lend((1000, 7))
    assert address(other) != place
    tensor, view = torch.from_numpy(first), first[3:5].T
    del first
    assert address(array_pool.lend((1000, 7))) != place, "a tensor and a view still hold it"
    del tensor
    assert address(array_pool.lend((1000, 7))) != place, "the view still holds it"
    del view
    gc.collect()
    again = [array_pool.lend((1000, 7)) for _ in range(3)]
    assert place in [address(a) for a in again]


def test_a_step_allocates_nothing_once_it_has_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process that lent and pooled nothing before: what is kept is the first that came back, whatever its size."""
    monkeypatch.setattr(array_pool, "_lender", array_pool._Lender())
    monkeypatch.setattr(array_pool, "_pool", [])
    surfels, view = with_gradients(random_surfels(300, 1)), camera(70, 50, 60.0)

    def step() -> None:
        for leaf in (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh):
            leaf.grad = None
        out = render(surfels, view, PLANES, label_count=5)
        torch.autograd.backward([getattr(out, p) for p in PLANES], [torch.ones_like(getattr(out, p)) for p in PLANES])

    def fresh_after(count: int) -> int:
        for _ in range(count):
            step()
        gc.collect()
        return array_pool._lender.fresh

    first = fresh_after(1)
    before = fresh_after(4)
    held = {k: id(v) for k, v in array_pool._pool[-1]._arrays.items()}
    # Another thread may let go of a step's arrays late: then the next one takes some anew, but not each of them.
    assert fresh_after(30) - before <= 2 * first
    assert {k: id(v) for k, v in array_pool._pool[-1]._arrays.items()} == held
