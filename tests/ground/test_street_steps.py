"""Points that are labelled ground and lie on crowns and roofs do not lift the street's border."""

from __future__ import annotations

import numpy as np

from tests.ground.test_street import drive_on_circle
from unveil_core.ground.path import fit_path
from unveil_core.ground.street_fit import fit_street_heights


def test_specks_high_up_at_the_border_are_no_bank() -> None:
    rng = np.random.default_rng(0)
    path = fit_path(drive_on_circle(80.0, 0.0))
    s, t = rng.uniform(0, 25, 20_000), rng.uniform(-8, 8, 20_000)
    bank = np.where(t < -6, 0.5 * (-6 - t), 0.0)  # a bank of 27 degrees is ground
    ground = np.column_stack([s, t, bank])
    high = np.column_stack([rng.uniform(0, 25, 150), rng.uniform(8.2, 9, 150), rng.uniform(4, 11, 150)])
    street = fit_street_heights(path, path.to_world(np.concatenate([ground, high])))
    at = np.linspace(3, 22, 20)
    for aside in np.arange(-7.5, 9.5, 0.25):
        height = street.height_at(at, np.full(20, aside))
        assert np.abs(height - max(0.0, 0.5 * (-6 - aside))).max() < 0.15, aside
    assert street.t_max.max() < 8.3
