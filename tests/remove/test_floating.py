"""Ground that floats where objects are seen."""

from __future__ import annotations

import numpy as np

from tests.ground.test_street import drive_on_circle, street_points
from unveil_core.ground.path import fit_path
from unveil_core.ground.street_fit import fit_street_heights
from unveil_core.remove.floating import floating_ground


def test_what_floats_in_front_of_an_object_goes_and_nothing_else() -> None:
    cameras = drive_on_circle(60.0, 0.03)
    path = fit_path(cameras)
    street = fit_street_heights(path, street_points(60.0, 0.03))
    s, t = np.meshgrid(np.arange(8, 14, 0.5), np.arange(-3, 3, 0.5), indexing="ij")
    ground = path.to_world(np.stack([s, t, street.height_at(s, t)], axis=-1).reshape(-1, 3))
    up = path.axes[2]
    means = np.concatenate([ground, ground + 0.8 * up, ground + 6.0 * up, ground + 0.8 * up])
    on_ground = np.repeat([True, True, True, False], len(ground))
    everywhere = [np.ones((c.height, c.width), bool) for c in cameras]
    floats = floating_ground(means, on_ground, street, cameras, everywhere).reshape(4, -1)
    assert floats[1].all()
    assert not floats[[0, 2, 3]].any()
    # Where most frames show no object, what floats is a kerb, a ramp, or a ground that was fitted badly.
    few = [m if i % 3 == 0 else ~m for i, m in enumerate(everywhere)]
    assert not floating_ground(means, on_ground, street, cameras, few).any()
