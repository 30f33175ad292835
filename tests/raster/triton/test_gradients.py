"""The Triton backend against the float64 reference: every plane, every gradient, and the hard cases."""

from __future__ import annotations

import pytest

from tests.raster.hard_cases import CASES
from tests.raster.scenes import GRADIENTS, camera, for_backend, random_surfels
from tests.raster.test_gradients import LIMIT, compare
from tests.raster.test_hard_cases import assert_alike
from unveil_core.raster.api import PLANES, render
from unveil_core.surfels.surfels import Surfels

pytest.importorskip("triton")
# Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


@pytest.mark.parametrize("plane", PLANES)
def test_plane_and_gradients_match_float64(plane: str) -> None:
    compare(random_surfels(30, 2, degree=2), plane, LIMIT, backend="triton", view=camera(24, 10, 20.0))


# The interpreter takes some milliseconds per surfel and tile: one small image, and not the cases of a thousand layers, which
# benchmarks/reconstruction/hard_cases.py measures.
@pytest.mark.parametrize("name", [name for name in CASES if not name.startswith("a thousand")])
def test_hard_case_keeps_its_stated_error(name: str) -> None:
    assert_alike(CASES[name], (17, 7), "triton")


def test_one_pixel() -> None:
    assert_alike(CASES["equal depths"], (1, 1), "triton")


def test_other_precision_is_refused() -> None:
    surfels = random_surfels(3, 0)
    surfels = for_backend(surfels, "triton")
    doubled = Surfels(*(getattr(surfels, n).double() for n in GRADIENTS), surfels.labels)
    with pytest.raises(ValueError, match="the triton backend needs torch.float32"):
        render(doubled, camera(), backend="triton")
