"""Stretches of a street: together they own all of it, and they part where least is removed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ground.test_blocks import straight
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import TEXEL_M, rows_of
from unveil_core.inpaint.stretches import AROUND_M, QUIET_M, Stretch, cut_street


def level_street(frames: int) -> Ground:
    path = fit_path([f.camera for f in straight(frames, 1.0).frames])
    count = int((frames + 60) / 0.25)
    ones = np.ones(count)
    return Ground(path, -15.0, -8.0, 0.25, 0.25, np.zeros((count, 65)), 8 * ones, -8 * ones)


def stretches_of(frames: int, length_m: float, removed: np.ndarray) -> tuple[Ground, list[Stretch]]:
    drive, ground = straight(frames, 1.0), level_street(frames)
    return ground, cut_street(ground, cut_into_blocks(drive, length_m), [f.camera for f in drive.frames], removed)


@pytest.mark.parametrize("length_m", [1000.0, 100.0, 37.0])
def test_each_row_has_one_owner(length_m: float) -> None:
    ground, stretches = stretches_of(301, length_m, np.zeros((0, 3)))
    owned = np.concatenate([np.arange(*s.rows) for s in stretches])
    assert owned.tolist() == list(range(rows_of(ground)))
    at = np.linspace(-400, 700, 1000)
    assert (sum(s.owns(at).astype(int) for s in stretches) == 1).all()
    for stretch in stretches:
        assert stretch.around[0] <= stretch.rows[0] and stretch.rows[1] <= stretch.around[1]
        assert set(stretch.own) <= set(stretch.frames)
        if stretch.rows[0] > 0:
            assert (
                abs((stretch.rows[0] - stretch.around[0]) * TEXEL_M - AROUND_M) < 2 * TEXEL_M or stretch.around[0] == 0
            )


def test_a_drive_of_one_block_is_one_stretch_of_everything() -> None:
    ground, (only,) = stretches_of(80, 100.0, np.zeros((0, 3)))
    assert only.rows == only.around == (0, rows_of(ground)) and only.frames == tuple(range(80))


def test_stretches_part_beside_a_lorry_not_within_it() -> None:
    lorry = np.column_stack([np.linspace(95.0, 107.0, 500), np.full(500, 3.0), np.full(500, 1.0)])
    _, stretches = stretches_of(201, 100.0, lorry)
    border = stretches[0].s[1]
    assert border == stretches[1].s[0] and abs(border - 100.0) <= QUIET_M
    assert border < 95.0 or border > 107.0
