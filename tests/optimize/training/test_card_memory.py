"""What a step takes of a GPU's memory, by counting; and what is said where it does not fit."""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import CPU, GPU, working_on
from unveil_core.optimize.training import card_memory, torch_losses
from unveil_core.optimize.training.card_memory import StepSize, fitting, place_for, step_bytes

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


def test_a_step_grows_with_all_that_it_works_on() -> None:
    for name, more in (("surfels", 2_000_000), ("coefficients", 16), ("width", 3000), ("height", 2000), ("labels", 20)):
        assert step_bytes(replace(LARGE, **{name: more})) > step_bytes(LARGE)


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
        place_for(replace(GPU, asked_for=True), lambda: LARGE)
    with working_on(GPU) as used:
        for _ in range(2):  # nobody asked for it: the processor has room
            place = place_for(GPU, lambda: LARGE)
    assert place.device == CPU and used.notes == [place.why]
    assert "training on the processor: 1,000,000 surfels" in place.why and "would fit" in place.why
    small = place_for(GPU, lambda: replace(LARGE, surfels=50_000, width=480, height=320))
    assert small.device == GPU and not small.why and small.fine_bytes > small.coarse_bytes > 0
    assert place_for(CPU, lambda: pytest.fail("nobody asks how large it is")).device == CPU
    monkeypatch.setattr(card_memory, "_free_bytes", lambda device: 1 << 29)
    with pytest.raises(SettingsError, match="use --device cpu"):
        place_for(replace(GPU, asked_for=True), lambda: LARGE)
