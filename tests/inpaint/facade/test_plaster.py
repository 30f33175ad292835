"""The plaster of two houses side by side, and what is like it."""

from __future__ import annotations

import numpy as np

from unveil_core.inpaint.facade.plaster import likeness, plaster_colors, unlike_plaster

PER_M = 10.0
WALLS = np.array([[0.5, 0.45, 0.3], [0.3, 0.35, 0.45]], dtype=np.float32)


def test_each_house_has_the_colour_that_most_of_it_has() -> None:
    color = np.repeat(np.repeat(WALLS, 100, axis=0)[:, None], 40, axis=1)
    color[10:190:20, 10:25] = 0.1  # windows
    known = np.ones(color.shape[:2], dtype=bool)
    known[:, :8] = False
    found = plaster_colors(np.where(known[..., None], color, 0.0), known, PER_M)
    np.testing.assert_allclose(found[:90], np.tile(WALLS[0], (90, 1)), atol=1e-6)
    np.testing.assert_allclose(found[110:], np.tile(WALLS[1], (90, 1)), atol=1e-6)


def test_plaster_in_the_shade_is_more_alike_than_another_hue() -> None:
    shaded, other = likeness(np.stack([0.7 * WALLS[0], WALLS[1]]), WALLS[:1])[:, 0]
    assert likeness(WALLS[:1], WALLS[:1]) == 1 and 0.5 < shaded < 1 and other < 0.2


def test_what_differs_from_the_plaster_in_one_channel_is_unlike_it() -> None:
    wall = np.array([[0.5, 0.4, 0.2]], dtype=np.float32)
    assert not unlike_plaster(wall * np.float32(1.05), wall).any()
    assert unlike_plaster(wall * np.array([1, 1, 1.3], dtype=np.float32), wall).all()
