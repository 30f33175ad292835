"""Sets of surfels joined: colours of other degrees, discs beside ellipsoids."""

from __future__ import annotations

import math

import numpy as np
import torch

from tests.raster.scenes import random_ellipsoids, random_surfels
from unveil_core.surfels.surfels import FLATNESS, concatenate


def test_joining_discs_keeps_them() -> None:
    plain, rich = random_surfels(3, 0, degree=0), random_surfels(4, 1, degree=2)
    both = concatenate([plain, rich])
    assert not both.ellipsoids and both.sh_degree == 2
    assert torch.equal(both.log_scales, torch.cat([plain.log_scales, rich.log_scales]))
    assert torch.equal(both.sh[:3, :1], plain.sh) and not both.sh[:3, 1:].any()


def test_discs_beside_ellipsoids_become_flat_ones() -> None:
    discs, solid = random_surfels(3, 0), random_ellipsoids(4, 1)
    both = concatenate([solid, discs])
    assert both.ellipsoids and torch.equal(both.log_scales[:4], solid.log_scales)
    assert torch.equal(both.log_scales[4:, :2], discs.log_scales)
    expected = discs.log_scales.amin(dim=1) + math.log(FLATNESS)
    torch.testing.assert_close(both.log_scales[4:, 2], expected)
    torch.testing.assert_close(both.normals()[4:], discs.normals())


def test_what_was_joined_is_split_again_without_a_copy() -> None:
    parts = [random_surfels(n, n) for n in (3, 1, 5)]
    both = concatenate(parts)
    for part, found in zip(parts, both.split([3, 1, 5]), strict=True):
        for name, array in part.arrays().items():
            np.testing.assert_array_equal(found.arrays()[name], array)
            assert np.shares_memory(found.arrays()[name], both.arrays()[name])
