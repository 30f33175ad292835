"""The Triton backend against the float64 reference: every plane, every gradient, and the hard cases."""

from __future__ import annotations

import pytest
import torch

from sample_scenes.hard_cases.hard_cases import CASES
from tests.raster.scenes import GRADIENTS, camera, random_surfels, with_gradients
from tests.raster.test_hard_cases import assert_alike
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.reference import render_reference
from unveil_core.surfels.surfels import Surfels

pytest.importorskip("triton")
LIMIT = 2e-5
pytestmark = [
    pytest.mark.skipif(torch.cuda.is_available(), reason="on a GPU, tensors go there first; see test_arrays"),
    # Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
    pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning"),
]


def value_and_gradients(surfels: Surfels, plane: str, backend: str) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    view = camera(40, 25, 34.0)
    leaves = with_gradients(surfels)
    value = getattr(render(leaves, view, [plane], label_count=5, backend=backend), plane)
    decided = ~render_reference(surfels, view, 5, near=0.2, far=100.0)["undecided"]
    g = torch.Generator().manual_seed(11)
    weight = torch.rand(value.shape, generator=g, dtype=torch.float64) * (
        decided if value.dim() == 2 else decided[..., None]
    )
    (value.double() * weight).sum().backward()
    gradients = {n: getattr(leaves, n).grad for n in GRADIENTS}
    return (value.detach().double() * (weight > 0)), {
        n: torch.zeros_like(getattr(surfels, n)) if v is None else v for n, v in gradients.items()
    }


@pytest.mark.parametrize("plane", PLANES)
def test_plane_and_gradients_match_float64(plane: str) -> None:
    surfels = random_surfels(70, 2, degree=2)
    value, gradients = value_and_gradients(surfels, plane, "triton")
    expected, reference = value_and_gradients(surfels, plane, "reference")
    assert float((value - expected).norm() / expected.norm()) < LIMIT
    largest = max(float(g.double().norm()) for g in reference.values())
    for name in GRADIENTS:
        a, b = gradients[name].double(), reference[name].double()
        if float(b.norm()) < 1e-6 * largest:
            assert float(a.norm()) < 1e-5 * largest, name
        else:
            assert float((a - b).norm() / b.norm()) < LIMIT, name


# The interpreter takes some milliseconds per surfel and tile: one small image, and not the thin layers, all of which
# it would have to go through.
@pytest.mark.parametrize("name", [name for name in CASES if name != "a thousand thin layers"])
def test_hard_case_keeps_its_stated_error(name: str) -> None:
    assert_alike(CASES[name], (17, 14), "triton")


def test_one_pixel() -> None:
    assert_alike(CASES["equal depths"], (1, 1), "triton")


def test_other_precision_is_refused() -> None:
    surfels = random_surfels(3, 0)
    doubled = Surfels(*(getattr(surfels, n).double() for n in GRADIENTS), surfels.labels)
    with pytest.raises(ValueError, match="the triton backend needs torch.float32"):
        render(doubled, camera(), backend="triton")
