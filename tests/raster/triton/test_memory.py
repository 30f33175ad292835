"""The bytes of a step are those that torch allocates, and the host waits for the GPU once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import torch
from torch.multiprocessing.reductions import StorageWeakRef
from torch.utils._python_dispatch import TorchDispatchMode

from tests.raster.scenes import DEVICE, GRADIENTS, camera, for_backend, random_surfels, with_gradients
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.passes import GROUPS, Settings
from unveil_core.surfels.surfels import Surfels

pytest.importorskip("triton")
from unveil_core.raster.triton import backend as gpu
from unveil_core.raster.triton.memory import step_bytes

# Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
# So that surfels, entries and pixels each weigh a third; few, as the interpreter takes milliseconds per surfel and tile.
COUNT, VIEW = 60, camera(32, 16, 25.0)


class Watch(TorchDispatchMode):
    """Bytes of the tensors that live, at most, and operations that make the host wait for a GPU."""

    # What reads a value or a size that only the GPU knows.
    WAITS = ("_local_scalar_dense", "nonzero", "masked_select", "unique", "bincount", "is_nonzero", "equal")

    def __init__(self) -> None:
        super().__init__()
        self.storages: dict[int, tuple[StorageWeakRef, int]] = {}
        self.peak, self.waits = 0, []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = func.__name__.split(".")[0]
        boolean_index = name == "index" and any(t is not None and t.dtype == torch.bool for t in args[1])
        sized_by_values = name == "repeat_interleave" and (kwargs or {}).get("output_size") is None
        if name in self.WAITS or boolean_index or sized_by_values:
            self.waits.append(name)
        out = func(*args, **(kwargs or {}))
        for t in out if isinstance(out, (tuple, list)) else (out,):
            if isinstance(t, torch.Tensor):
                storage = t.untyped_storage()
                self.storages[storage._cdata] = (StorageWeakRef(storage), storage.nbytes())
        self.storages = {k: v for k, v in self.storages.items() if not v[0].expired()}
        self.peak = max(self.peak, sum(size for _, size in self.storages.values()))
        return out


@contextmanager
def watched() -> Iterator[Watch]:
    with Watch() as watch:
        yield watch


def intersections_of(surfels: Surfels, planes: tuple[str, ...]) -> int:
    settings = Settings("colour", 19, surfels.sh.shape[1], 0.2, 100.0, planes=planes)
    inputs = tuple(getattr(surfels, name) for name in GRADIENTS)
    done = gpu.forward_pass(inputs, surfels.labels, VIEW, settings, keep=True)  # type: ignore[arg-type]
    assert done.lists is not None
    return len(done.lists.ids)


@pytest.mark.parametrize(
    "planes", [("rgb", "alpha"), PLANES[:-1], PLANES], ids=["colour", "no label distortion", "all"]
)
def test_bytes_of_a_step_are_those_that_torch_allocates(planes: tuple[str, ...]) -> None:
    surfels = for_backend(random_surfels(COUNT, 3, degree=1), "triton")
    surfels.log_scales.sub_(2.5)
    labels = 5
    expected = step_bytes(COUNT, intersections_of(surfels, planes), 32, 16, labels, planes, sh_rows=4)
    with watched() as watch:
        leaves = with_gradients(surfels)
        out = render(leaves, VIEW, planes, label_count=labels, backend="triton", check=False)
        torch.autograd.backward([getattr(out, p) for p in planes], [torch.ones_like(getattr(out, p)) for p in planes])
    # The labels were there before, and Adam was not run.
    mine = expected["peak"] - expected["adam"] - 8 * COUNT
    # The gradient of the semantics came label after label, as they lie: no copy was needed.
    mine -= 4 * 32 * 16 * labels if "semantics" in planes else 0
    assert 0.97 * watch.peak < mine < 1.03 * watch.peak


def test_a_million_surfels_fit_three_gigabytes() -> None:
    # 862,841 of a million are visible in the benchmark's corridor; ten tiles each is a scene of large surfels.
    assert step_bytes(1_000_000, 8_600_000, 1920, 1280, 19, PLANES)["peak"] < 3e9
    assert step_bytes(1_000_000, 8_600_000, 1920, 1280, 19, ("rgb", "alpha"))["peak"] < 2e9


@pytest.mark.parametrize("group", GROUPS)
def test_planes_that_are_not_asked_for_take_no_bytes(group: str) -> None:
    surfels, view = for_backend(random_surfels(8, 1), "triton"), camera(20, 18, 17.0)
    inputs = tuple(getattr(surfels, name) for name in GRADIENTS)
    for keep in (False, True):
        settings = Settings(group, 5, 4, 0.2, 100.0, planes=("rgb", "semantics", "depth"))
        done = gpu.forward_pass(inputs, surfels.labels, view, settings, keep=keep)  # type: ignore[arg-type]
        assert "label_distortion" not in done.planes and done.by_label.numel() == 0
        assert done.kept.numel() == (0 if not keep else 4 * 256 * (6 if GROUPS[group].geometry else 2))
        assert (done.lists is not None) == keep


def test_the_host_waits_once_for_a_step_and_once_more_to_check_its_values() -> None:
    surfels, view = for_backend(random_surfels(8, 1), "triton"), camera(20, 18, 17.0)
    for check in (False, True):
        leaves = with_gradients(surfels)
        with watched() as watch:
            out = render(leaves, view, PLANES, label_count=5, backend="triton", check=check)
            sum(getattr(out, p).sum() for p in PLANES).backward()  # type: ignore[union-attr]
        if DEVICE == "cuda" or not check:
            assert watch.waits == ["_local_scalar_dense"] * (2 if check else 1), check


def test_a_value_that_is_not_finite_is_found_on_any_device() -> None:
    surfels = for_backend(random_surfels(8, 1), "triton")
    surfels.quats[5, 2] = float("nan")
    with pytest.raises(ValueError, match="^quats is not finite in row 5$"):
        render(surfels, camera(20, 18, 17.0), backend="triton")
