"""The ground under removed objects: what light reached it is relit, what is black is invented."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from unveil_core.base.srgb import linear_light, relight
from unveil_core.inpaint.light.relight import shadows_of_removed
from unveil_core.inpaint.light.shade import Shade

PER_M = 25.0


def under_a_lorry() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A street (A, B, 3) with a line under a lorry whose shade is deeper towards its middle, the lorry's footprint (A, B), and the
    share of light (A, B)."""
    rows, columns = 300, 200
    light = np.ones((rows, columns), np.float32)
    footprint = np.zeros((rows, columns), bool)
    footprint[80:220, 90:170] = True
    inward = cv2.distanceTransform(footprint.astype(np.uint8), cv2.DIST_L2, 5)
    light[footprint] = np.clip(0.75 - inward[footprint] / 40, 0.01, 1)
    color = np.full((rows, columns, 3), 0.5, np.float32)
    color[:, 96:100] = 0.85
    return relight(color, light[..., None]), footprint, light


def test_a_line_under_a_lorry_is_relit_and_what_is_black_is_not() -> None:
    color, footprint, light = under_a_lorry()
    seen = np.ones_like(footprint)
    lit = linear_light(np.full_like(color, 0.5))
    shade = Shade(light < 0.8, np.ones(3, np.float32), lit)
    shadow, hopeless = shadows_of_removed(color, seen, shade, footprint, None, reach_m=2.0, per_m=PER_M)
    assert shadow[footprint].all()
    line = footprint.copy()
    line[:, :96] = line[:, 100:] = False
    assert hopeless[line & (light > 0.25)].mean() < 0.05
    # Relit, the noise of a code would grow by more than three.
    assert hopeless[footprint & (light < 0.06)].all()
    # Beside what is black, pixels mix with it.
    near = cv2.dilate((footprint & (light < 0.06)).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert hopeless[near & footprint].all()


@pytest.mark.parametrize(("gap", "goes"), [(0.45, False), (0.42, False), (0.3, True)])
def test_in_the_shade_of_houses_the_ground_between_two_cars_is_in_no_shadow_of_theirs(gap: float, goes: bool) -> None:
    """Elsewhere along the street the sun shines where these cars stand, so all that is seen there seems dark."""
    rows, columns = 400, 200
    color = np.full((rows, columns, 3), 0.45, np.float32)
    footprint = np.zeros((rows, columns), bool)
    footprint[40:150, 120:165] = footprint[200:310, 120:165] = True
    between = np.zeros_like(footprint)
    between[150:200, 112:170] = True
    color[between] = gap
    lane = np.zeros_like(footprint)
    lane[:, 110:] = True
    seen = ~footprint & (~lane | between)
    shade = Shade(seen & lane, np.ones(3, np.float32), linear_light(np.full_like(color, 0.9)))
    shadow, _ = shadows_of_removed(color, seen, shade, footprint, None, reach_m=2.0, per_m=PER_M)
    assert shadow[between].mean() == (1.0 if goes else 0.0)
