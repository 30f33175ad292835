"""How many of points and Gaussians are shown."""

from __future__ import annotations

import numpy as np

from blender_addon.formats.splats import fair_share


def test_few_are_all_shown_and_many_evenly() -> None:
    assert fair_share(5, 10).tolist() == [0, 1, 2, 3, 4]
    some = fair_share(10_000, 500)
    assert len(np.unique(some)) == 500 and (np.diff(some) > 0).all()
    quarters = np.histogram(some, bins=4, range=(0, 10_000))[0]
    assert quarters.min() > 90  # none is passed over
    assert (fair_share(10_000, 500) == some).all()  # the same each time: what is there already stays
