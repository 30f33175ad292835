"""Stages on a device of its own: every plane comes back through the one helper, and nothing mixes it with what is here."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import unveil_core
from tests.optimize.training.test_devices import LABELS, scene, turned
from unveil_core.base.kernels.device import GPU, Device, working_on
from unveil_core.raster import Rendered, on_device, picture, render
from unveil_core.raster.api import PLANES
from unveil_core.raster.on_device import array, rendered, there
from unveil_core.raster.picture import levels_seen, picture_of, render_numpy
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

ROOT = Path(unveil_core.__file__).parent
MAY_RENDER = (
    "raster/",
    "bench/",
    "optimize/training/",
    "optimize/adaptation/probes.py",
    "remove/remains.py",
    "app/doctor.py",
    "forecast/machine.py",
    "__init__.py",
)
"""Who calls ``render`` itself: what trains, weighs by gradients, or measures the processor."""


class Far(Tensor):
    """A tensor that is here and behaves as if it were on a GPU: it can be brought here, and meets no tensor that is."""

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = getattr(func, "__name__", "")
        leaves = torch.utils._pytree.tree_leaves((args, kwargs or {}))
        if name == "numpy":
            raise TypeError("can't convert a device's tensor to numpy")
        if any(isinstance(x, Tensor) and not isinstance(x, Far) and x.dim() for x in leaves):
            raise RuntimeError(f"{name}: expected all tensors to be on the same device")
        found = super().__torch_function__(func, types, args, kwargs or {})
        return found.as_subclass(Tensor) if name == "cpu" else found


def far_render(surfels: Surfels, camera: Any, outputs: Collection[str], **more: Any) -> Rendered:
    out = render(surfels, camera, outputs, **more)
    planes = {name: getattr(out, name) for name in PLANES}
    return replace(out, **{name: p if p is None else p.as_subclass(Far) for name, p in planes.items()})


def test_the_far_tensor_tells_who_mixes_it() -> None:
    far, near = torch.ones(3).as_subclass(Far), torch.ones(3)
    with pytest.raises(TypeError):
        far.numpy()
    with pytest.raises(RuntimeError, match="same device"):
        far + near
    with pytest.raises(RuntimeError, match="same device"):
        near * (far + 1)
    assert type((far * 2).double().argmax()) is Far and type(far.detach().cpu()) is Tensor
    assert np.array_equal(array(2 * far), [2, 2, 2])


def test_only_who_must_calls_the_rasterizer_itself() -> None:
    planes = "|".join(PLANES)
    for path in sorted(ROOT.rglob("*.py")):
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        if not name.startswith(MAY_RENDER):
            assert not re.search(r"unveil_core\.raster(\.api)? import [^\n]*\brender\b", text), name
            assert not re.search(rf"\.({planes})\.(double\(\)\.|float\(\)\.)?numpy\(", text), name


def test_pictures_are_the_same_and_come_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    surfels, camera = scene(), turned(0.05)
    sky = Sky(torch.full((3, 8, 16), 0.5), np.eye(3))
    here = picture_of(surfels, sky, camera, near=0.2, far=100.0)
    arrays = render_numpy(surfels, camera, near=0.2, far=100.0, apart=(1,))
    monkeypatch.setattr(on_device, "render", far_render)
    assert np.array_equal(picture_of(surfels, sky, camera, near=0.2, far=100.0), here)
    again = render_numpy(surfels, camera, near=0.2, far=100.0, apart=(1,))
    assert all(np.array_equal(again[name], plane) for name, plane in arrays.items())


def test_a_picture_that_is_finished_there_is_the_same() -> None:
    """The device's own way to a picture, on the processor's planes."""
    surfels, camera = scene(), turned(0.3)
    sky = Sky(torch.rand(3, 16, 32, generator=torch.Generator().manual_seed(2)), np.eye(3)[[2, 0, 1]])
    out = rendered(surfels, camera, ("rgb", "alpha"), near=0.2, far=100.0)
    here = levels_seen(surfels, sky, camera, near=0.2, far=100.0)
    other = picture._over_sky_there(out, sky, camera)
    assert other.dtype == np.float32 and np.abs(other - here).max() < 0.05


def test_a_scene_is_brought_to_a_device_once() -> None:
    first, second, third = scene(), scene(), scene()
    assert there(first) is first
    with working_on(Device("meta")):
        one = there(first)
        assert one.device.type == "meta" and there(first) is one and there(second) is not one
        assert there(first) is one
        there(third)
        assert there(first) is one  # the one that was asked for least lately went
        assert there(one) is one
    assert there(first) is first


def test_planes_of_the_gpu_s_backend_are_those_of_the_processor_s() -> None:
    pytest.importorskip("triton")
    there = GPU if torch.cuda.is_available() else Device("cpu", backend="triton")  # else in the interpreter
    planes = ("rgb", "alpha", "depth", "semantics")
    here = rendered(scene(), turned(0.0), planes, label_count=LABELS, near=0.2, far=100.0)
    with working_on(there):
        other = rendered(scene(), turned(0.0), planes, label_count=LABELS, near=0.2, far=100.0)
    for name in planes:
        np.testing.assert_allclose(array(getattr(other, name)), array(getattr(here, name)), atol=1e-4)


def test_where_the_gpu_has_no_memory_left_the_processor_renders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the GPU was asked for. What fails here is the first rendering, as the GPU's would."""
    surfels, camera = scene(), turned(0.0)

    def full(
        surfels: Surfels, camera: Any, outputs: Collection[str], *, backend: str = "auto", **more: Any
    ) -> Rendered:
        if backend == "triton":
            raise RuntimeError("Triton Error [CUDA]: out of memory")
        return render(surfels, camera, outputs, backend=backend, **more)

    monkeypatch.setattr(on_device, "render", full)
    with working_on(Device("cpu", "triton")) as used:
        found = rendered(surfels, camera, ("rgb",), near=0.1, far=100.0)
        rendered(surfels, camera, ("rgb",), near=0.1, far=100.0)
    expected = render(surfels, camera, ("rgb",), near=0.1, far=100.0)
    assert np.array_equal(array(found.rgb), array(expected.rgb))
    assert used.notes == ["rendering on the processor: the GPU has no memory left"]
    with working_on(Device("cpu", "triton", asked_for=True)), pytest.raises(RuntimeError, match="out of memory"):
        rendered(surfels, camera, ("rgb",), near=0.1, far=100.0)


def test_a_scene_is_looked_at_once_until_it_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []

    def noting(*args: Any, check: bool = True, **more: Any) -> Rendered:
        looks.append(check)
        return render(*args, check=check, **more)

    monkeypatch.setattr(on_device, "render", noting)
    surfels, camera = scene(), turned(0.0)
    planes = ("rgb", "alpha", "semantics")
    first = rendered(surfels, camera, planes, near=0.2, far=100.0)
    again = rendered(surfels, camera, planes, near=0.2, far=100.0)
    assert looks == [True, False]
    for name in planes:
        assert torch.equal(getattr(first, name), getattr(again, name))
    with pytest.raises(ValueError, match="label"):  # fewer labels than were found are looked at again
        rendered(surfels, camera, planes, label_count=1, near=0.2, far=100.0)
    with torch.no_grad():
        surfels.means[3, 1] = float("nan")
    with pytest.raises(ValueError, match="means is not finite in row 3"):
        rendered(surfels, camera, planes, near=0.2, far=100.0)
    with torch.no_grad():
        surfels.means[3, 1] = 0.0
    rendered(surfels, camera, planes, near=0.2, far=100.0)
    rendered(replace(surfels), camera, planes, near=0.2, far=100.0)
    assert looks == [True, False, True, True, True, True]
