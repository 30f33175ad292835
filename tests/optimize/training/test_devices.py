"""A training step on any device: the same step as by the fused kernels, all on one device, and never a wait for it."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training import trainer
from unveil_core.optimize.training.density import DensitySettings
from unveil_core.optimize.training.losses import LossWeights
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.trainer import READ_EVERY, Optimization, TrainSettings
from unveil_core.optimize.training.views import TrainingView, training_view, views_on
from unveil_core.raster import Rendered
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

WIDTH, HEIGHT, LABELS = 32, 16, 3
META = torch.device("meta")
EVERYTHING = LossWeights(distortion=1.0, label_distortion=1.0, depth=0.5)


def turned(angle: float) -> Camera:
    """A camera that looks along z, a little to the side."""
    matrix = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    matrix[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return Camera(WIDTH, HEIGHT, 30.0, 30.0, WIDTH / 2, HEIGHT / 2, matrix)


def scene(count: int = 40) -> Surfels:
    rng = np.random.default_rng(0)
    places = rng.uniform((-1.2, -0.6, 2), (1.2, 0.6, 4), (count, 3))
    return Surfels(
        torch.tensor(places, dtype=torch.float32),
        torch.tensor(rng.normal(size=(count, 4)), dtype=torch.float32),
        torch.tensor(rng.uniform(-2.4, -1.6, (count, 2)), dtype=torch.float32),
        torch.tensor(rng.normal(size=count), dtype=torch.float32),
        torch.tensor(0.3 * rng.normal(size=(count, 4, 3)), dtype=torch.float32),
        torch.tensor(rng.integers(0, 2, count)),
    )


def sky() -> Sky:
    return Sky(torch.rand(3, 8, 16, generator=torch.Generator().manual_seed(4)), np.eye(3)[[2, 0, 1]])


def views() -> list[TrainingView]:
    rng = np.random.default_rng(1)
    found = []
    for angle in (-0.1, 0.0, 0.1):
        image = rng.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
        weight = (rng.random((HEIGHT, WIDTH)) > 0.2).astype(np.float32)
        view = training_view(turned(angle), image, rng.integers(-1, LABELS, (HEIGHT, WIDTH)), weight, sky())
        found.append(view)
    return found


def begun(device: torch.device | str = "cpu", moving: Tensor | None = None, **settings: Any) -> Optimization:
    grows = DensitySettings(budget=60)
    wanted = TrainSettings(**{"weights": EVERYTHING, "density": grows, **settings})
    rates = LearningRates(means=0.004)
    start = scene().to(device)
    return Optimization(
        start, sky(), wanted, rates, label_count=LABELS, sky_label=2, spared_labels=(1,), moving=moving, seed=3
    )


def test_both_arithmetics_take_the_same_steps() -> None:
    fused, by_torch = begun(), begun(kernels="torch")
    for state in (fused, by_torch):
        for turn in range(6):
            state.step(views(), geometry=turn > 2, done=turn / 10)
    by_torch.checkpoint()  # which looks at the loss
    assert by_torch.loss == pytest.approx(fused.loss, rel=1e-5)
    for name, leaf in fused.trainable.leaves.items():
        torch.testing.assert_close(by_torch.trainable.leaves[name], leaf, rtol=1e-3, atol=2e-4, msg=name)
    torch.testing.assert_close(by_torch.texture, fused.texture, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("geometry", [False, True])
def test_each_gradient_is_the_same(geometry: bool) -> None:
    states = [begun(), begun(kernels="torch")]
    for state in states:
        view, surfels = views()[0], state.trainable.surfels
        out = state._render(surfels, view, geometry)
        state._loss(out, surfels, view, geometry).backward()
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
        one, other = (state.trainable.leaves[name].grad for state in states)
        assert one is not None and other is not None and float(one.abs().max()) > 0
        assert float((one - other).abs().max()) <= 1e-5 * max(1.0, float(one.abs().max())), name


WAITS = {
    "_local_scalar_dense",
    "nonzero",
    "is_nonzero",
    "masked_select",
    "equal",
    "_unique2",
    "unique_dim",
    "unique_consecutive",
    "repeat_interleave",
}
"""ATen's operations whose result, or whose result's shape, the host needs: on a GPU it waits for all that was asked before."""


class Waits(TorchDispatchMode):
    """Counts what would make the host wait for the device."""

    def __init__(self) -> None:
        super().__init__()
        self.found: Counter[str] = Counter()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = func._schema.name.partition("::")[2]
        by_mask = name in ("index", "index_put", "index_put_") and any(
            isinstance(i, Tensor) and i.dtype in (torch.bool, torch.uint8) for i in args[1]
        )
        if name in WAITS or by_mask:
            self.found[name] += 1
        return func(*args, **(kwargs or {}))


def test_a_steady_step_does_not_wait_for_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    held, state = views(), begun(kernels="torch")
    taken: list[str] = []
    monkeypatch.setattr(Tensor, "numpy", noted(Tensor.numpy, taken, inside=("optimize/training",)))
    with Waits() as waits:
        for turn in range(READ_EVERY + 1):  # the first look at the loss, and the second one
            state.step(held, geometry=turn % 2 == 1, done=0.0)
    assert dict(waits.found) == {"_local_scalar_dense": 2} and not taken
    with Waits() as waits:
        begun().step(held, geometry=True, done=0.0)
    assert (
        waits.found["_local_scalar_dense"] >= 1
    )  # the fused path looks at once: the counter sees what there is to see


def noted(function: Any, into: list[str], inside: tuple[str, ...]) -> Any:
    """The function, which notes calls from files of some folders."""
    import sys

    def call(self: Tensor, *args: Any, **named: Any) -> Any:
        file = sys._getframe(1).f_code.co_filename
        if any(folder in file for folder in inside):
            into.append(file)
        return function(self, *args, **named)

    return call


def planes_there(surfels: Surfels, camera: Camera, names: Any, *, label_count: int, **_: Any) -> Rendered:
    """Planes without values in the place of a rasterizer's, differentiable in all parameters."""
    leaves = (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh)
    all_of_it = torch.stack([leaf.sum() for leaf in leaves]).sum()
    shapes = {"rgb": (3,), "normal": (3,), "semantics": (label_count,)}
    planes = {
        name: all_of_it.expand(camera.height, camera.width, *shapes.get(name, ())) if name in names else None
        for name in ("rgb", "alpha", "semantics", "depth", "median_depth", "normal", "distortion", "label_distortion")
    }
    count = len(surfels)
    screen = torch.zeros(count, 2, device=surfels.device)
    return Rendered(
        **planes, visible=torch.ones(count, dtype=torch.bool, device=surfels.device), _screen_gradients=lambda: screen
    )


@pytest.mark.parametrize("only_some", [False, True])
def test_all_of_a_step_is_on_the_surfels_device(only_some: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """On torch's device without values: what mixes it with the processor's tensors, or asks for a value, is an error there."""
    monkeypatch.setattr(trainer, "render", planes_there)
    monkeypatch.setattr(trainer, "READ_EVERY", 10**6)
    state = begun(META, moving=torch.ones(40, dtype=torch.bool) if only_some else None)
    there = views_on(views(), sky(), META, 1 << 30)
    state._mean, state._since = torch.zeros((), device=META), 0  # after the first look
    for turn in range(4):
        state.step(there, geometry=turn > 1, done=0.0)
    assert {leaf.device.type for leaf in state.trainable.leaves.values()} == {"meta"} == {state.texture.device.type}
    if state.density is not None:
        assert {t.device.type for t in state.density.tensors().values()} == {"meta"}
    with pytest.raises(RuntimeError):
        state.step(views(), geometry=True, done=0.0)  # the processor's views are told from the device's


def test_the_sky_is_looked_up_alike_on_a_device() -> None:
    view, panorama = views()[0], sky()
    there = view.to(torch.device("cpu"), panorama)
    assert there.sky_grid is None
    one, other = (panorama.sample(v.sky_positions(panorama)) for v in (view, there))
    torch.testing.assert_close(other, one, atol=1e-5, rtol=0)
    assert torch.equal(there.forward, view.forward)


def test_training_goes_on_with_the_other_arithmetic() -> None:
    held, first = views(), begun()
    first.step(held, geometry=False, done=0.0)
    second = begun(kernels="torch")
    arrays, facts = first.checkpoint()
    second.restore({name: array.copy() for name, array in arrays.items()}, facts)  # as read from a file
    for state in (first, second):
        state.step(held, geometry=False, done=0.1)
    second.checkpoint()
    assert second.loss == pytest.approx(first.loss, rel=1e-5)
    for name, leaf in first.trainable.leaves.items():
        torch.testing.assert_close(second.trainable.leaves[name], leaf, rtol=1e-3, atol=2e-4)


def test_the_gpu_s_kernels_train_as_the_processor_s() -> None:
    """Rasterizer and arithmetic of the GPU: on one where there is one, else in Triton's interpreter."""
    pytest.importorskip("triton")
    there = torch.device("cuda:0" if torch.cuda.is_available() else "cpu")
    held, states = views(), [begun(), begun(there, kernels="torch", backend="triton")]
    for state, targets in zip(states, (held, views_on(held, sky(), there, 1 << 30)), strict=True):
        for turn in range(2):
            state.step(targets, geometry=turn == 1, done=0.0)
    for name, leaf in states[0].trainable.leaves.items():
        torch.testing.assert_close(states[1].trainable.leaves[name].cpu(), leaf, rtol=1e-3, atol=1e-3, msg=name)
    assert states[0].density is not None and states[1].density is not None
    torch.testing.assert_close(states[1].density.gradient.cpu(), states[0].density.gradient, rtol=1e-3, atol=1e-6)
    before = len(states[1])
    states[1].density.settings = DensitySettings(gradient_threshold=0.0, budget=60)
    states[1].grow()
    states[1].prune()
    assert len(states[1]) != before
    states[1].step(views_on(held, sky(), there, 1 << 30), geometry=False, done=0.0)
    assert states[1].result()[0].device == there


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_the_driver_sees_no_wait_in_a_steady_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a GPU torch itself raises where the host would wait; the rasterizer, which asks for sizes, is left out."""
    state, rasterize = begun("cuda:0"), trainer.render
    held = views_on(views(), sky(), torch.device("cuda:0"), 1 << 30)

    def unwatched(*args: Any, **named: Any) -> Rendered:
        torch.cuda.set_sync_debug_mode("default")
        try:
            return rasterize(*args, **named)
        finally:
            torch.cuda.set_sync_debug_mode("error")

    for _ in range(len(held)):  # views come there, kernels are compiled, the loss is looked at
        state.step(held, geometry=True, done=0.0)
    monkeypatch.setattr(trainer, "render", unwatched)
    try:
        for _ in range(len(held)):
            torch.cuda.set_sync_debug_mode("error")
            state.step(held, geometry=True, done=0.0)
    finally:
        torch.cuda.set_sync_debug_mode("default")
