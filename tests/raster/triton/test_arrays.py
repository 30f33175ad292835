"""Stage by stage, the Triton backend's arrays are the CPU backend's: records, lists of the tiles reached, planes, gradients."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
import torch

from tests.raster.scenes import DEVICE, camera, random_surfels
from tests.raster.triton.test_binning import assert_lists
from unveil_core.geometry.camera import Camera
from unveil_core.raster import records as rec
from unveil_core.raster.cpu import backend as cpu
from unveil_core.raster.passes import GROUPS, Inputs, Settings
from unveil_core.raster.spec import ALPHA_MIN
from unveil_core.surfels.surfels import Surfels

pytest.importorskip("triton")
from unveil_core.raster.triton import backend as gpu

# Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
# The interpreter takes milliseconds per surfel and tile; a GPU gets enough blocks to show a race between them.
COUNT, VIEW = (45, camera(34, 20, 28.0)) if DEVICE == "cpu" else (20_000, camera(480, 320, 400.0))


def inputs_of(surfels: Surfels) -> Inputs:
    return surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh


def passes(surfels: Surfels, view: Camera, group: str, label_count: int = 5) -> tuple[cpu.Pass, gpu.Pass]:
    settings = Settings(group, label_count, surfels.sh.shape[1], 0.2, 100.0)
    inputs = inputs_of(surfels)
    on_device = tuple(t.to(DEVICE) for t in inputs)
    a = cpu.forward_pass(inputs, surfels.labels, view, settings, keep=True)
    b = gpu.forward_pass(on_device, surfels.labels.to(DEVICE), view, settings, keep=True)  # type: ignore[arg-type]
    return a, b


def gradients_of(planes: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    g = torch.Generator().manual_seed(3)
    return {name: torch.randn(plane.shape, generator=g) for name, plane in planes.items() if plane.numel()}


def assert_close(a: object, b: torch.Tensor, limit: float, name: str) -> None:
    x, y = torch.as_tensor(np.asarray(a)).double(), b.cpu().double()
    assert x.shape == y.shape, name
    if x.numel():
        assert float((x - y).abs().max()) <= limit * max(1.0, float(x.abs().max())), name


def assert_planes_close(a: torch.Tensor, b: torch.Tensor, name: str) -> None:
    """Alike; on a card, whose exponential differs in the last digit, a surfel at the least alpha that counts may count for one
    backend alone: seldom, and by no more than that alpha of what the plane holds."""
    if DEVICE == "cpu":
        assert_close(a, b, 5e-6, name)
        return
    away = (a.double() - b.cpu().double()).abs() / max(1.0, float(a.abs().max()))
    if away.numel():
        assert float(away.max()) <= ALPHA_MIN and float((away > 5e-6).double().mean()) < 1e-4, name


@pytest.mark.parametrize("group", GROUPS)
def test_every_array_is_the_cpu_backends(group: str) -> None:
    surfels = random_surfels(COUNT, 4, degree=3)
    a, b = passes(surfels, VIEW, group)
    seen = a.visible.numpy()
    assert COUNT / 3 < seen.sum() < COUNT and len(a.bins.ids) > 1.3 * seen.sum()
    np.testing.assert_array_equal(seen, b.visible.cpu().numpy())
    for k in range(rec.SIZE):
        # Float64 until it is rounded: two roundings may differ in the last digit.
        assert_close(a.records[seen, k], b.records[b.visible][:, k], 2e-7, f"record {k}")
    assert b.lists is not None
    assert_lists(a, b.lists, VIEW, spare=0.02)
    for name, plane in a.planes.items():
        assert_planes_close(plane, b.planes[name], name)
    inputs = inputs_of(surfels)
    grads = gradients_of(a.planes)
    ours = cpu.backward_pass(a, grads, inputs)
    theirs = gpu.backward_pass(b, {n: g.to(DEVICE) for n, g in grads.items()}, tuple(t.to(DEVICE) for t in inputs))  # type: ignore[arg-type]
    for name, x, y in zip(
        ("means", "quats", "log_scales", "opacity_logits", "sh", "screen"), ours, theirs, strict=True
    ):
        assert x.shape == y.shape
        assert float((x.double() - y.cpu().double()).norm() / x.double().norm()) < 1e-5, name
    cpu.release(a)


def test_two_runs_give_the_same_bits() -> None:
    surfels, view = random_surfels(25, 5), camera(20, 18, 17.0)
    inputs = tuple(t.to(DEVICE) for t in inputs_of(surfels))
    settings = Settings("all", 5, surfels.sh.shape[1], 0.2, 100.0)
    results = []
    for _ in range(2):
        done = gpu.forward_pass(inputs, surfels.labels.to(DEVICE), view, settings, keep=True)  # type: ignore[arg-type]
        planes = {name: plane.clone() for name, plane in done.planes.items()}
        grads = {name: g.to(DEVICE) for name, g in gradients_of(planes).items()}
        results.append([*planes.values(), *gpu.backward_pass(done, grads, inputs)])  # type: ignore[arg-type]
    assert all(torch.equal(x, y) for x, y in zip(*results, strict=True))
