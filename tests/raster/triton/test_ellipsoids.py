"""Surfels with three scales on the Triton backend, against float64 and where they might break."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.raster.cpu.test_ellipsoids import HARD
from tests.raster.hard_cases import HardCase
from tests.raster.scenes import camera, random_ellipsoids
from tests.raster.test_gradients import LIMIT, compare
from tests.raster.test_hard_cases import assert_alike
from unveil_core.raster.api import PLANES

pytest.importorskip("triton")
# Numbers too large for float32 in masked lanes: the interpreter is numpy, which remarks on them.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")


@pytest.mark.parametrize("plane", [p for p in PLANES if p not in ("alpha", "semantics")])
def test_plane_and_gradients_match_float64(plane: str) -> None:
    compare(random_ellipsoids(24, 2, degree=2), plane, LIMIT, backend="triton", view=camera(24, 10, 20.0))


def test_ones_beyond_the_field_of_view_match_float64() -> None:
    surfels = random_ellipsoids(40, 1, spread=2.2, grazing=True)
    compare(replace(surfels, means=surfels.means * 0.5), "rgb", LIMIT, backend="triton", view=camera(24, 10, 20.0))


@pytest.mark.parametrize("name", HARD)
def test_hard_one_is_finite_and_matches_float64(name: str) -> None:
    # Thousands of pixels aside, float32 places a centre to a few ten-thousandths of a pixel.
    assert_alike(HardCase(HARD[name], limit=1e-4 if name == "far off the axis" else 2e-5), (17, 7), "triton")
