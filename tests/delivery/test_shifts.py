"""Invented ground takes its grain from seen ground of its kind."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.delivery.shifts import GroundShifts, find_shifts

TEXEL = 0.05
S_START, T_START = -3.0, -6.0
ROAD, SIDEWALK, GRASS = 0, 1, 9


def street(length_m: float = 30.0, width_m: float = 12.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """observed, made and kinds: all seen, with a road in the middle and a sidewalk of 3 m to either side."""
    shape = (round(length_m / TEXEL), round(width_m / TEXEL))
    kinds = np.full(shape, ROAD, np.int16)
    edge = round(3 / TEXEL)
    kinds[:, :edge] = kinds[:, -edge:] = SIDEWALK
    return np.ones(shape, bool), np.zeros(shape, bool), kinds


def texels(s: tuple[float, float], t: tuple[float, float]) -> tuple[slice, slice]:
    """The texels of a rectangle in street coordinates."""
    rows, columns = (
        slice(round((low - start) / TEXEL), round((high - start) / TEXEL))
        for (low, high), start in ((s, S_START), (t, T_START))
    )
    return rows, columns


def found(observed: np.ndarray, made: np.ndarray, kinds: np.ndarray) -> GroundShifts:
    return find_shifts(observed & ~made, made, kinds, s_start=S_START, t_start=T_START, texel=TEXEL)


def grid(s: tuple[float, float], t: tuple[float, float]) -> np.ndarray:
    a, b = np.meshgrid(np.arange(s[0] + 0.05, s[1], 0.1), np.arange(t[0] + 0.05, t[1], 0.1))
    return np.stack([a.ravel(), b.ravel()], axis=1)


@pytest.mark.parametrize("hole", [((8, 13), (-2.6, 0.2)), ((8, 13), (-5.6, -3.6)), ((2, 6), (3.6, 5.4))])
def test_a_shift_leads_to_seen_ground_of_the_same_kind(hole: tuple[tuple[float, float], tuple[float, float]]) -> None:
    observed, made, kinds = street()
    made[texels(*hole)] = True
    shifts = found(observed, made, kinds)
    places = grid(*hole)
    assert shifts.is_made(places).all()
    there = places + shifts.at(places)
    assert np.isfinite(there).all()
    index = np.floor((there - (S_START, T_START)) / TEXEL).astype(int)
    inside = (index >= 0).all(axis=1) & (index < kinds.shape).all(axis=1)
    kind_here = kinds[tuple(np.floor((places - (S_START, T_START)) / TEXEL).astype(int).T)]
    good = np.zeros(len(places), bool)
    rows, columns = index[inside].T
    good[inside] = (observed & ~made)[rows, columns] & (kinds[rows, columns] == kind_here[inside])
    assert good.mean() > 0.9


def test_a_block_shares_one_shift_so_that_grain_stays_in_place() -> None:
    observed, made, kinds = street()
    made[texels((8, 13), (-2, 1))] = True
    shifts = found(observed, made, kinds)
    places = grid((8, 13), (-2, 1))
    blocks = np.floor((places - (shifts.s_start, shifts.t_start)) / shifts.block)
    for block in np.unique(blocks, axis=0):
        own = shifts.at(places[(blocks == block).all(axis=1)])
        assert np.ptp(own, axis=0).max() == 0
    assert len(np.unique(blocks, axis=0)) > 10


def test_across_the_street_is_preferred_and_along_it_taken_where_nothing_else_is_left() -> None:
    observed, made, kinds = street()
    made[texels((8, 13), (-2, 1))] = True
    middle = np.array([[10.5, -0.5]])
    (shift,) = found(observed, made, kinds).at(middle)
    assert shift[0] == 0 and abs(shift[1]) >= 1.4
    observed[texels((5, 16), (-3, 3))] = False  # nobody saw the road beside it
    (shift,) = found(observed, made, kinds).at(middle)
    assert abs(shift[0]) > 5


def test_ground_of_another_kind_is_not_taken() -> None:
    observed, made, kinds = street()
    hole = texels((8, 13), (-2, 1))
    kinds[hole] = GRASS
    made[hole] = True
    shifts = found(observed, made, kinds)
    places = grid((8, 13), (-2, 1))
    assert np.isnan(shifts.at(places)).all() and shifts.is_made(places).all()


def test_what_was_seen_is_not_made_and_nothing_made_needs_no_shift() -> None:
    observed, made, kinds = street()
    made[texels((8, 13), (-2, 1))] = True
    shifts = found(observed, made, kinds)
    assert not shifts.is_made(grid((0, 6), (-5, 5))).any() and not shifts.is_made(np.array([[500.0, 0], [0, 90]])).any()
    assert np.isnan(shifts.at(np.array([[500.0, 0.0]]))).all()
    none = found(observed, np.zeros_like(made), kinds)
    assert np.isnan(none.at(grid((0, 20), (-5, 5)))).all()
