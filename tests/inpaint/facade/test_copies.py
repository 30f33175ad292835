"""Where invented facades were copied from: it looks the same there, and comes back from disk as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.inpaint.facade.test_continued import FACADE_T, behind_a_car, houses, street, stripes
from unveil_core.base.errors import WorkspaceError
from unveil_core.inpaint.facade.copies import FacadeCopies, copied_from, read_copies, save_copies
from unveil_core.inpaint.facade.facade_chart import invented_facades, read_facade


@pytest.fixture(scope="module")
def copies() -> FacadeCopies:
    """Of the facade behind a car."""
    ground, views = behind_a_car()
    chart = read_facade(ground, houses(np.inf), views, left=True, texel_m=0.05)
    assert chart is not None
    found = invented_facades(chart, label=3, sh_degree=1).copies
    assert found is not None
    return found


def behind_the_car() -> tuple[np.ndarray, np.ndarray]:
    """Street coordinates of the facade, and heights over the ground."""
    s, height = (p.ravel() for p in np.meshgrid(np.arange(11.0, 12.8, 0.07), np.arange(0.1, 1.0, 0.07), indexing="ij"))
    return np.column_stack([s, np.full(len(s), FACADE_T + 0.1), height]), height


def test_a_copy_looks_like_what_it_was_copied_from_and_that_is_seen(copies: FacadeCopies) -> None:
    places, height = behind_the_car()
    some, there, ratio = copies.origin(places, height)
    assert len(some) > 0.8 * len(places)
    assert np.median(np.abs(stripes(there[:, 0], height[some]) - stripes(places[some, 0], height[some]))) == 0
    assert np.abs(there[:, 0] - places[some, 0]).min() > 0.5 and np.abs(there[:, 1] - places[some, 1]).max() < 0.2
    again = copies.origin(np.column_stack([there, height[some]]), height[some])
    assert len(again[0]) == 0  # nothing is copied from a copy
    assert np.abs(ratio - 1).max() < 0.1


def test_what_stands_before_the_facade_or_beyond_it_was_not_copied(copies: FacadeCopies) -> None:
    places, height = behind_the_car()
    for move in ((0, 1.0, 0), (0, -1.0, 0), (40.0, 0, 0), (-40.0, 0, 0)):
        assert len(copies.origin(places + move, height)[0]) == 0
    for high in (-1.0, 5.0, 90.0):
        assert len(copies.origin(places, np.full(len(places), high))[0]) == 0


@pytest.mark.parametrize(("first", "last"), [(0.0, 11.0), (10.0, 12.0), (11.0, 30.0)])
def test_a_part_is_copied_from_the_same_places(copies: FacadeCopies, first: float, last: float) -> None:
    part = copies.part((copies.s >= first) & (copies.s < last))
    assert part is not None
    places, height = behind_the_car()
    whole, own = copies.origin(places, height), part.origin(places, height)
    inside = (places[whole[0], 0] >= first) & (places[whole[0], 0] < last)
    edge = np.abs(places[:, 0][:, None] - (first, last)).min(axis=1) < 0.05
    assert set(whole[0][inside]) ^ set(own[0]) <= set(np.flatnonzero(edge))
    both = np.isin(whole[0], own[0])
    np.testing.assert_allclose(whole[1][both], own[1][np.isin(own[0], whole[0])], atol=1e-6)


def test_world_points_lead_to_world_points_whatever_else_stands_along_the_street(copies: FacadeCopies) -> None:
    ground, _ = street(np.inf)
    elsewhere = FacadeCopies(copies.copied, copies.rows, copies.place + (500.0, 0.0))
    look = copied_from(ground, [elsewhere, copies])
    assert look is not None and copied_from(ground, []) is None
    places, height = behind_the_car()
    some, there, ratio = look(ground.path.to_world(places))
    expected = copies.origin(places, height)
    np.testing.assert_array_equal(some, expected[0])
    np.testing.assert_allclose(ground.path.to_street(there)[:, :2], expected[1], atol=1e-6)
    np.testing.assert_allclose(there[:, 2], height[some], atol=0.02)
    assert ratio.shape == (len(some), 3)
    for far in (-900.0, 250.0, 2000.0):
        assert len(look(ground.path.to_world(places + (far, 0, 0)))[0]) == 0


def test_nothing_of_it_is_no_part(copies: FacadeCopies) -> None:
    assert copies.part(np.zeros(len(copies.s), dtype=bool)) is None


def test_disk(copies: FacadeCopies, tmp_path: Path) -> None:
    path = tmp_path / "facades.npz"
    save_copies([copies, copies], path)
    found = read_copies(path)
    assert len(found) == 2
    for name in ("copied", "rows", "place"):
        np.testing.assert_array_equal(getattr(found[1], name), getattr(copies, name))
    save_copies([], path)
    assert read_copies(path) == []


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("0.copied", np.zeros((4, 3), np.uint8)),
        ("0.copied", np.zeros((5, 3), bool)),
        ("0.rows", np.full((4, 6), np.nan, np.float32)),
        ("0.place", np.zeros(2)),
        ("1.place", np.ones(2)),
    ],
)
def test_what_is_damaged_is_said(name: str, array: np.ndarray, tmp_path: Path) -> None:
    arrays = {"0.copied": np.ones((4, 3), bool), "0.rows": np.ones((4, 6), np.float32), "0.place": np.ones(2)}
    np.savez(tmp_path / "facades.npz", **arrays)
    assert len(read_copies(tmp_path / "facades.npz")) == 1
    np.savez(tmp_path / "facades.npz", **{**arrays, name: array}, more=np.ones(1), last=np.ones(1))
    with pytest.raises(WorkspaceError, match=r"facades\.npz: tells no copies"):
        read_copies(tmp_path / "facades.npz")
