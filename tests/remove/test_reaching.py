"""Surfels that reach behind removed objects: shortened to what frames show of them, and nothing else is touched."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.remove.test_observed import HEIGHT, WIDTH, seen_from, together, wall_view
from unveil_core.remove.observed import SeenViews
from unveil_core.remove.reaching import REACH, shortened
from unveil_core.surfels.scene_edit import Shortened
from unveil_core.surfels.surfels import Surfels


def row_of_surfels(centres: np.ndarray, scales: np.ndarray) -> Surfels:
    """Surfels that face the camera, their axes along x and y."""
    count = len(centres)
    return Surfels(
        torch.tensor(centres, dtype=torch.float32),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        torch.tensor(scales, dtype=torch.float32).log(),
        torch.full((count,), 3.0),
        torch.zeros(count, 1, 3),
        torch.zeros(count, dtype=torch.int64),
    )


def one_view() -> SeenViews:
    """A wall at z = 10 with an object before its part from x = 0 to 2.5, where 4 pixels are a metre."""
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[5:38, 30:40] = True
    return together([seen_from(0, *wall_view(0, hidden))])


def test_an_end_behind_the_object_goes() -> None:
    # The first reaches from -1.5 to 1; the second lies beside the object; of the third only an end is seen.
    centres = np.array([[-0.25, 2.0, 10.0], [-3.0, 2.0, 10.0], [0.5, 2.0, 10.0]])
    scene = row_of_surfels(centres, np.array([[0.5, 0.02], [0.5, 0.02], [0.5, 0.02]]))
    stays = np.ones(3, dtype=bool)
    found = shortened(scene, stays, one_view())
    assert sorted(found.index.tolist()) == [0, 2]
    after = found.of(scene)
    for i in (0, 2):
        half = REACH * after.log_scales[i, 0].exp()
        ends = [float(after.means[i, 0] - half), float(after.means[i, 0] + half)]
        assert abs(ends[0] - (centres[i, 0] - 1.25)) < 1e-5 and ends[1] < 0.01
        assert torch.equal(after.log_scales[i, 1], scene.log_scales[i, 1])
        assert torch.equal(after.means[i, 1:], scene.means[i, 1:])
    assert torch.equal(after.means[1], scene.means[1])
    assert len(shortened(scene, ~stays, one_view()).index) == 0


def test_an_end_that_no_picture_holds_goes() -> None:
    scene = row_of_surfels(np.array([[-7.4, 2.0, 10.0], [-3.0, 2.0, 10.0]]), np.array([[0.41, 0.41], [900.0, 0.02]]))
    found = shortened(scene, np.ones(2, dtype=bool), one_view())
    after = found.of(scene)
    assert sorted(found.index.tolist()) == [0, 1]
    ends = after.means[:, 0, None] + REACH * after.log_scales[:, :1].exp() * torch.tensor([-1.0, 1.0])
    assert (ends > -8.0).all() and float(ends[0, 1]) < -6.3
    # A street is 15 m wide in this picture, and the surfel was kilometres long.
    assert float(after.log_scales[1, 0].exp()) < 3.0


def test_what_nobody_sees_stays_as_it_is() -> None:
    # One lies behind the object with both its ends, one far behind the wall.
    scene = row_of_surfels(np.array([[1.2, 2.0, 10.0], [-3.0, 4.0, 20.0]]), np.full((2, 2), 0.41))
    assert len(shortened(scene, np.ones(2, dtype=bool), one_view()).index) == 0


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 12), st.integers(0, 2**16))
def test_surfels_only_shrink_and_the_table_keeps_them(count: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    centres = generator.uniform([-8, -6, 2], [8, 6, 14], (count, 3))
    scene = row_of_surfels(centres, generator.uniform(0.01, 2.0, (count, 2)))
    found = shortened(scene, np.ones(count, dtype=bool), one_view())
    kept = Shortened.from_table(found.table())
    for name in ("index", "means", "log_scales"):
        assert np.array_equal(getattr(kept, name), getattr(found, name))
    after = kept.of(scene)
    assert torch.isfinite(after.log_scales).all() and torch.isfinite(after.means).all()
    assert (after.log_scales <= scene.log_scales).all()
    # The part that is left lies within the surfel as it was.
    grown = (after.means - scene.means).abs()[:, :2] + REACH * after.log_scales.exp()
    assert (grown <= REACH * scene.log_scales.exp() * (1 + 1e-4) + 1e-5).all()
