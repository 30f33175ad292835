"""A kerb whose face is turned from the sun, and one that is turned to it, on a street that lies partly in shadow."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.inpaint.light.kerb_shade import shade_of_kerbs
from unveil_core.inpaint.light.shade import Shade

PER_M, USUAL = 25.0, 0.45
ROWS, COLUMNS, KERB = 600, 120, slice(60, 65)


def kerb_street(own: float, *, split: bool = True) -> tuple[np.ndarray, Shade]:
    """The first half of the street lies in shadow, which leaves ``own`` of the kerb's colour; a shade read with one ratio."""
    rng = np.random.default_rng(0)
    lit = np.full((ROWS, COLUMNS), 0.5)
    lit[:, KERB] = 0.3 if own > USUAL else 0.8
    dark = np.zeros((ROWS, COLUMNS), dtype=bool)
    dark[: ROWS // 2 if split else 0] = True
    left = np.full((ROWS, COLUMNS), USUAL)
    left[:, KERB] = own
    color = np.where(dark, lit * left, lit) * (1 + 0.03 * rng.standard_normal((ROWS, COLUMNS)))
    read = dark.copy()
    if own > 0.7:
        read[:, KERB] = False  # as dark in the sun as in the shade
    ratio = np.full(3, USUAL, dtype=np.float32)
    rgb = np.repeat(color[..., None], 3, axis=2).astype(np.float32)
    return rgb, Shade(read, ratio, np.repeat(lit[..., None], 3, axis=2).astype(np.float32))


@pytest.mark.parametrize("own", [0.9, 0.25])
def test_a_kerb_has_its_own_ratio(own: float) -> None:
    color, shade = kerb_street(own)
    sharp = np.ones(shade.dark.shape, dtype=bool)
    found = shade_of_kerbs(color, sharp, shade, texels_per_m=PER_M)
    assert found.ratio.shape == color.shape
    middle = slice(KERB.start + 1, KERB.stop - 1)
    assert np.abs(found.ratio[:, middle] - own).max() < 0.05
    assert np.abs(found.ratio[:, :50] - USUAL).max() < 1e-6
    # Between two sides in shadow it lies in shadow, however little that changes it.
    assert found.dark[20 : ROWS // 2 - 20, middle].all()
    assert not found.dark[ROWS // 2 + 20 :].any()


def test_what_was_not_seen_in_both_keeps_the_usual_ratio() -> None:
    for color, shade in (kerb_street(0.9, split=False), kerb_street(0.9)):
        nothing = np.zeros(shade.dark.shape, dtype=bool)
        sharp = nothing if shade.dark.any() else ~nothing
        found = shade_of_kerbs(color, sharp, shade, texels_per_m=PER_M)
        assert np.allclose(found.ratio, USUAL) and np.array_equal(found.dark, shade.dark)


def test_bars_of_a_crossing_in_the_shade_are_no_face() -> None:
    """White bars fill more than half of what is seen of the shade, and are as bright there as the road in the sun."""
    color, shade = kerb_street(USUAL)
    color[:, KERB] = np.where(shade.dark[:, KERB, None], 0.5 * USUAL, 0.5)
    sharp = np.ones(shade.dark.shape, dtype=bool)
    sharp[: ROWS // 4] = False
    for first in (50, 64, 78):
        color[170:260, first : first + 8] = 0.5
    found = shade_of_kerbs(color, sharp, shade, texels_per_m=PER_M)
    assert np.allclose(found.ratio, USUAL)
