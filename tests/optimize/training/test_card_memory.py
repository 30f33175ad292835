"""What a step takes of a GPU's memory, by counting; and what is said where it does not fit."""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from tests.raster.scenes import camera, random_surfels
from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import CPU, GPU, working_on
from unveil_core.optimize.adaptation import colour_degree
from unveil_core.optimize.adaptation.choices import AdaptSettings, Looks
from unveil_core.optimize.adaptation.colour_degree import choose_sh_degree
from unveil_core.optimize.training import card_memory, torch_losses
from unveil_core.optimize.training.card_memory import (
    StepSize,
    fitting,
    largest_step,
    place_for,
    state_bytes,
    step_bytes,
    trial_of_degrees,
)
from unveil_core.optimize.training.density import DensitySettings
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.schedule import Phase
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import MOST_RAYS, _rays, training_view
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import with_sh_degree

LARGE = StepSize(surfels=1_000_000, coefficients=1, width=1920, height=1280, labels=19)


class Held(TorchDispatchMode):
    """Counts the bytes of tensors that operations made and that still live."""

    def __init__(self) -> None:
        super().__init__()
        self.now = self.most = 0
        self.known: set[int] = set()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        out = func(*args, **(kwargs or {}))
        for tensor in torch.utils._pytree.tree_leaves(out):
            if isinstance(tensor, Tensor) and (storage := tensor.untyped_storage())._cdata not in self.known:
                self.known.add(storage._cdata)
                self.now += storage.nbytes()
                self.most = max(self.most, self.now)
                weakref.finalize(storage, self.gone, storage._cdata, storage.nbytes())
        return out

    def gone(self, key: int, size: int) -> None:
        self.known.discard(key)
        self.now -= size


def test_the_losses_hold_no_more_than_is_counted() -> None:
    h, w, k = 48, 64, 19
    image, normal = torch.rand(2, h, w, 3).unbind()
    alpha, depth = (torch.rand(2, h, w) + 0.1).unbind()
    semantics, labels = torch.rand(h, w, k), torch.randint(0, k, (h, w))
    for leaf in (image, normal, alpha, depth, semantics):
        leaf.requires_grad_(True)
    weight, rays, target = torch.rand(h, w), torch.rand(h, w, 3), torch.rand(h, w, 3)
    with Held() as held:
        loss = torch_losses.l1_dssim(image, target, weight)
        loss = loss + torch_losses.semantic_cross_entropy(semantics, alpha, labels, sky_label=1, weight=weight)
        loss = loss + torch_losses.normal_consistency(normal, depth, alpha, rays, weight)
        loss.backward()
    a_pixel = held.most / (h * w)
    # Beside what the rasterizer's planes and their gradients take, which count for themselves.
    assert 0.5 < a_pixel / (card_memory.BYTES_A_LOSS + 8 * k) <= 1


GROWS: tuple[tuple[str, Any], ...] = (
    ("surfels", 2_000_000),
    ("coefficients", 16),
    ("width", 3000),
    ("height", 2000),
    ("labels", 20),
    ("lenses", 2),
    ("held", (4,)),
)


def test_a_step_grows_with_all_that_it_works_on() -> None:
    for name, more in GROWS:
        assert step_bytes(replace(LARGE, **{name: more})) > step_bytes(LARGE)


def _storages(states: list[Optimization]) -> dict[int, int]:
    """Bytes of the memory that tensors of some states lie in, by its address."""
    tensors: list[Tensor] = []
    for state in states:
        t, density = state.trainable, state.density
        tensors += [*t.leaves.values(), *t.first.values(), *t.second.values(), t.labels, state.texture]
        tensors += [] if density is None else density.tensors().values()
    return {tensor.untyped_storage().data_ptr(): tensor.untyped_storage().nbytes() for tensor in tensors}


def test_the_states_of_the_trial_of_degrees_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that the trial keeps, a state for each degree; steps and looks, which keep nothing, are left out."""
    monkeypatch.setattr(Optimization, "step", lambda *given, **named: None)
    monkeypatch.setattr(colour_degree, "probe_error", lambda *given: 0.01)
    degree, count = 2, 400
    surfels = with_sh_degree(random_surfels(count, 1, degree=degree), degree)
    sky = Sky(torch.full((3, 4, 8), 0.5), np.eye(3))
    settings = TrainSettings(sky_rate=0.0, density=DensitySettings())
    state = Optimization(surfels, sky, settings, LearningRates(means=1e-3), label_count=2, sky_label=None)
    view = training_view(camera(16, 12, 15.0), np.zeros((12, 16, 3), np.uint8), None, None, sky)
    begun = Looks(AdaptSettings(), {"coarse": [view]})
    kept: list[Optimization] = []
    copied = Optimization.copy
    monkeypatch.setattr(Optimization, "copy", lambda self: kept.append(copied(self)) or kept[-1])
    choose_sh_degree(state, Phase("coarse", [view], 1, False, 0.5, 0.5), 1, begun)
    assert len(kept) == degree + 1
    # The state that the trial began with is there before; the last trial's is the one that is stepped.
    step = trial_of_degrees(StepSize(900, (degree + 1) ** 2, 16, 12, 2), count)
    assert step.surfels == count and (step.width, step.height) == (8, 6) and step.held == (1, 4, 9)
    counted = sum(state_bytes(count, coefficients) for coefficients in step.held)
    before, made = _storages([state]), _storages(kept)
    assert 0.97 * counted < sum(made[key] for key in made.keys() - before.keys()) < 1.03 * counted


def test_the_rays_of_a_camera_are_kept_once_at_each_size() -> None:
    cameras = [replace(camera(64, 48, 40.0 + k % 3), world_to_camera=np.eye(4)) for k in range(9)]
    step = largest_step(1000, 0, cameras, 2)
    assert step.lenses == 3
    sky = Sky(torch.full((3, 4, 8), 0.5), np.eye(3))
    _rays.cache_clear()
    picture = np.zeros((48, 64, 3), np.uint8)
    views = [training_view(c, picture, None, None, sky, factor=f) for c in cameras for f in (1.0, 0.5)]
    with Held() as held:
        kept = [view.rays for view in views]
    distinct = {id(rays): rays.nbytes for rays in kept}
    assert len(distinct) == 6 and sum(distinct.values()) == card_memory.BYTES_OF_RAYS * 64 * 48 * 3 <= held.now
    more = step_bytes(replace(step, lenses=4)) - step_bytes(step)
    assert more == pytest.approx(card_memory.SPARE * card_memory.BYTES_OF_RAYS * 64 * 48, abs=1)
    # No more than the cache keeps.
    assert step_bytes(replace(step, lenses=500)) == step_bytes(replace(step, lenses=MOST_RAYS))


@pytest.mark.parametrize("share", [0.4, 0.6, 0.8, 0.99])
def test_what_would_fit_fits(share: float) -> None:
    free = int(share * step_bytes(LARGE))
    options = fitting(LARGE, free)
    assert options is not None
    given = dict(zip(options.split()[::2], map(int, options.split()[1::2]), strict=True))
    side = given.get("--work-side", LARGE.width)
    smaller = replace(
        LARGE, surfels=given.get("--splats", LARGE.surfels), width=side, height=round(LARGE.height * side / LARGE.width)
    )
    assert step_bytes(smaller) <= free


def test_a_small_card_is_told_with_what_would_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(card_memory, "_free_bytes", lambda device: 2 << 30)
    with pytest.raises(
        SettingsError, match=r"1,000,000 surfels at 1920x1280 need .* of the GPU's memory, 2.0 GB are free"
    ):
        place_for(replace(GPU, asked_for=True), lambda: (LARGE,))
    with working_on(GPU) as used:
        for _ in range(2):  # nobody asked for it: the processor has room
            place = place_for(GPU, lambda: (LARGE,))
    assert place.device == CPU and used.notes == [place.why]
    assert "training on the processor: 1,000,000 surfels" in place.why and "would fit" in place.why
    small = place_for(GPU, lambda: (replace(LARGE, surfels=50_000, width=480, height=320),))
    assert small.device == GPU and not small.why and small.fine_bytes > small.coarse_bytes > 0
    assert place_for(CPU, lambda: pytest.fail("nobody asks how large it is")).device == CPU
    monkeypatch.setattr(card_memory, "_free_bytes", lambda device: 1 << 29)
    with pytest.raises(SettingsError, match="use --device cpu"):
        place_for(replace(GPU, asked_for=True), lambda: (LARGE,))
