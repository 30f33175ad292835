"""Tile lists: the tiles that surfels reach, in the CPU backend's order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.raster.hard_cases import CASES
from tests.raster.scenes import DEVICE, camera, for_backend, random_surfels
from unveil_core.geometry.camera import Camera
from unveil_core.raster import records as rec
from unveil_core.raster.cpu import backend as cpu
from unveil_core.raster.passes import Settings, tile_counts
from unveil_core.surfels.surfels import Surfels

pytest.importorskip("triton")
from unveil_core.raster.triton import backend as gpu
from unveil_core.raster.triton import binning
from unveil_core.raster.triton.binning import Lists, bin_surfels

# Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


def reached(records: np.ndarray, tile: np.ndarray, tiles_x: int, margin: float) -> np.ndarray:
    """Whether surfels reach between the pixel centres of tiles, in float64, each pair on its own.

    A convex function is least over a box at the box's point nearest to its centre along one of the two facing edges.
    """
    r = records.astype(np.float64).T
    low = np.stack([tile % tiles_x, tile // tiles_x]) * 16.0 + 0.5 - margin
    high = low + 15.0 + 2 * margin

    def box(cx: np.ndarray, cy: np.ndarray) -> tuple[np.ndarray, ...]:
        lx, ly, hx, hy = low[0] - cx, low[1] - cy, high[0] - cx, high[1] - cy
        return lx, ly, hx, hy, np.clip(0, lx, hx), np.clip(0, ly, hy)

    lx, ly, hx, hy, nx, ny = box(r[rec.EX], r[rec.EY])
    e0, e1, e2 = r[rec.E0], r[rec.E1], r[rec.E2]
    sides = (np.clip(-ny * e1 / e0, lx, hx), ny), (nx, np.clip(-nx * e0 * e1 / (e1 * e1 + e2 * e2), ly, hy))
    met = np.zeros(len(tile), bool)
    for x, y in sides:
        met |= (e0 * x + e1 * y) ** 2 + (e2 * y) ** 2 <= 1
    *_, nx, ny = box(r[rec.CX], r[rec.CY])
    return met | (nx * nx + ny * ny <= r[rec.LABEL_LOW] % rec.LOW_RANGE)


def assert_lists(a: cpu.Pass, lists: Lists, view: Camera, *, spare: float) -> None:
    """The GPU's lists are the CPU's without the tiles that are not reached; at most so large a part may be too many."""
    tiles_x, _ = tile_counts(view.width, view.height)
    ids, offsets = lists.ids.cpu().numpy(), lists.offsets.cpu().numpy()
    tile = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    whole = np.repeat(np.arange(len(offsets) - 1), np.diff(a.bins.offsets))
    records = a.records[a.bins.ids]
    must, may = (reached(records, whole, tiles_x, margin) for margin in (0.0, 0.1))
    mine = {(t, i): k for k, (t, i) in enumerate(zip(tile, ids, strict=True))}
    assert len(mine) == len(ids)
    places = [mine.get(pair, -1) for pair in zip(whole, a.bins.ids, strict=True)]
    listed = np.array([place >= 0 for place in places], bool)
    assert listed.sum() == len(ids)
    assert bool(listed[must].all())
    # Between the ellipse and the circle of a surfel, all of a row's tiles are listed.
    assert (listed & ~may).sum() <= spare * len(ids)
    # In the same order, and each with a row of its own among those of its surfel.
    assert (np.diff([place for place in places if place >= 0]) > 0).all()
    place, start, count = (t.cpu().numpy() for t in (lists.place, lists.start, lists.count))
    assert sorted(place) == list(range(len(ids))) and count.sum() == len(ids)
    assert ((start[ids] <= place) & (place < start[ids] + count[ids])).all()


def lists_of(surfels: Surfels, view: Camera) -> tuple[cpu.Pass, Lists]:
    """The CPU backend's pass, and the lists on the GPU."""
    settings = Settings("colour", 19, surfels.sh.shape[1], 0.2, 100.0)
    a = cpu.forward_pass(surfels_inputs(surfels), surfels.labels, view, settings, keep=True)
    there = for_backend(surfels, "triton")
    pose = gpu._pose(view, 0.2, torch.device(DEVICE))
    projected = gpu._project(surfels_inputs(there), there.labels, view, settings, pose)
    return a, bin_surfels(*projected, *tile_counts(view.width, view.height))


def surfels_inputs(surfels: Surfels) -> tuple[torch.Tensor, ...]:
    return surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh


@pytest.mark.parametrize(
    "name", ["crosses the camera's plane", "a kilometre", "edge-on, lying", "edge-on, standing", "empty"]
)
def test_lists_of_hard_cases_are_the_cpu_backends(name: str) -> None:
    case = CASES[name]
    view = case.camera(37, 21)
    a, lists = lists_of(case.surfels, view)
    assert_lists(a, lists, view, spare=0.0)
    cpu.release(a)


@pytest.mark.parametrize("seed", [0, 1])
def test_needles_are_listed_along_themselves(seed: int) -> None:
    """A slanted needle's box is mostly empty: the tiles beside it are dropped, and none that it crosses."""
    view = camera(400, 300, 300.0)
    surfels = random_surfels(60, seed)
    surfels = replace(surfels, log_scales=torch.tensor([[-5.0, 0.3]]).expand(60, 2).contiguous())
    a, lists = lists_of(surfels, view)
    assert len(lists.ids) < 0.4 * len(a.bins.ids)
    assert_lists(a, lists, view, spare=0.05)
    cpu.release(a)


def test_long_keys_give_the_same_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    view = camera(100, 80, 60.0)
    surfels = random_surfels(40, 3)
    a, short = lists_of(surfels, view)
    monkeypatch.setattr(binning, "SHORT_KEYS", 0)
    b, long = lists_of(surfels, view)
    assert (short.tiles.dtype, long.tiles.dtype) == (torch.int16, torch.int32)
    assert torch.equal(short.ids, long.ids) and torch.equal(short.place, long.place)
    lengths = (short.offsets[1:] - short.offsets[:-1])[short.turn.long()]
    assert bool((lengths[1:] <= lengths[:-1]).all()) and int(lengths[0]) > int(lengths[-1])
    cpu.release(a)
    cpu.release(b)
