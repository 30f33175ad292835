"""Holes in charts: where they are made, what they are filled with by whom, and what is measured of them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.real_drives.chart_holes import ChartOf, charts_of, measured, of_hole, row_line, row_of
from benchmarks.real_drives.fill_charts import UNSEEN, HoledStreet
from benchmarks.real_drives.holes import MARGIN_M, MOST_SHARE, footprints_of, hole_sets, seen_well
from benchmarks.real_drives.paired import clustered
from benchmarks.real_drives.trees import Tree
from docs.generate import ROOT
from unveil_core.inpaint.chart.street_chart import OUTSIDE, PLANES
from unveil_core.inpaint.stretches import Stretch

TEXEL_M = 0.1


def test_footprints_are_those_of_objects_of_usual_sizes() -> None:
    objects = np.zeros((200, 120), np.uint16)
    objects[10:50, 20:38], objects[100:103, 5:8], objects[60:180, 40:110] = 1, 2, 3
    (car,) = footprints_of(objects, TEXEL_M)  # neither the stray nor the block of houses
    assert car.shape == (40, 18) and car.all()
    (usual,) = footprints_of(np.zeros_like(objects), TEXEL_M)
    assert usual.shape == (44, 18)


def test_a_truth_was_seen_from_near_and_away_from_what_stands_there() -> None:
    source, nearest = np.ones((60, 60), np.uint8), np.full((60, 60), 5.0, np.float32)
    objects = np.zeros((60, 60), np.uint16)
    source[:, 50:], nearest[40:], objects[:10, :10] = 3, 20.0, 1
    good = seen_well(source, nearest, objects, TEXEL_M)
    assert good[30, 30] and not good[30, 55] and not good[50, 30]
    assert not good[5, 15] and good[5, 25]


def test_holes_lie_on_what_was_seen_well_apart_and_the_same_again() -> None:
    good = np.zeros((600, 120), dtype=bool)
    good[:, 20:100] = True
    stamps = [np.ones((40, 18), dtype=bool), np.ones((20, 10), dtype=bool)]
    sets = hole_sets(good, stamps, count=30, texel=TEXEL_M, seed=3)
    assert sum(len(s.listed) for s in sets) == 30 and len(sets) > 1
    for made in sets:
        numbers = np.unique(made.holes[made.holes > 0]).tolist()
        assert numbers == [hole.number for hole in made.listed] == list(range(1, len(numbers) + 1))
        assert (made.holes > 0)[good].mean() <= MOST_SHARE + 0.02 and (made.holes[~good] > 0).mean() < 0.01
        assert (made.holes[made.footprint] > 0).all()
        # Each is a piece of its own, a margin wider than what stood there.
        count, _ = cv2.connectedComponents((made.holes > 0).astype(np.uint8))
        assert count - 1 == len(numbers)
        reach = round(MARGIN_M / TEXEL_M)
        inner = cv2.erode((made.holes > 0).astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
        assert np.array_equal(inner, made.footprint)
    again = hole_sets(good, stamps, count=30, texel=TEXEL_M, seed=3)
    assert all(np.array_equal(a.holes, b.holes) for a, b in zip(sets, again, strict=True))
    assert hole_sets(np.zeros_like(good), stamps, count=30, texel=TEXEL_M) == []


def test_what_lies_over_each_other_is_one_measurement() -> None:
    figures = {"1": {"psnr": 20.0, "lpips": None}, "2": {"psnr": 24.0, "lpips": 0.2}, "3": {"psnr": 30.0, "lpips": 0.1}}
    found = clustered(figures, {"1": "a", "2": "a", "3": "b"})
    assert found == {"a": {"psnr": 22.0, "lpips": 0.2}, "b": {"psnr": 30.0, "lpips": 0.1}}


def test_a_stretch_reads_the_kept_chart_with_the_holes_in_it() -> None:
    rng = np.random.default_rng(0)
    street = HoledStreet.__new__(HoledStreet)
    street.ground = None  # type: ignore[assignment]
    street.chart = {
        "color": rng.random((50, 20, 3)).astype(np.float32),
        "label": np.full((50, 20), 4, np.int16),
        "source": np.ones((50, 20), np.uint8),
        "gain": np.ones((50, 20, 3), np.float32),
        "nearest": np.full((50, 20), 3, np.float32),
        "replaced": np.zeros((50, 20), bool),
        "place": np.array([2.0, -1.0, 0.04]),
    }
    street.holes = np.zeros((50, 20), bool)
    street.holes[15:25, 5:9] = True
    chart = street._read_own(Stretch(0, (0,), (0,), (10, 40), (0, 50), (0, 1), (0, 1)))
    hole = street.holes[10:40]
    assert chart.s_start == pytest.approx(2.4) and set(UNSEEN) == set(PLANES)
    assert (
        (chart.source[hole] == OUTSIDE).all()
        and (chart.label[hole] == -1).all()
        and np.isinf(chart.nearest[hole]).all()
    )
    assert np.array_equal(chart.color[~hole], street.chart["color"][10:40][~hole]) and not chart.color[hole].any()
    assert all(getattr(chart, name).dtype == street.chart[name].dtype for name in PLANES)


@pytest.fixture
def chart(tmp_path: Path) -> ChartOf:
    """A chart with two holes in one set, and a fill of it that is 5 levels off."""
    chart = ChartOf("drive", tmp_path, tmp_path)
    color = np.random.default_rng(1).integers(60, 180, (200, 150, 3), dtype=np.uint8)
    holes = np.zeros((200, 150), np.uint16)
    holes[20:60, 20:40], holes[120:160, 90:110] = 1, 2
    nothing = np.zeros((200, 150), np.uint16)
    np.savez(
        tmp_path / "chart.npz",
        color=color.astype(np.float32) / 255,
        source=np.ones((200, 150), np.uint8),
        nearest=np.full((200, 150), 4, np.float32),
        objects=nothing,
        place=np.array([0.0, 0.0, 0.04]),
    )
    for folder, planes in (
        ("sets", {"holes": holes, "footprint": holes > 0}),
        ("tree", {"color": color + np.uint8(5)}),
    ):
        (tmp_path / folder).mkdir()
        np.savez(tmp_path / folder / "000.npz", **planes)  # type: ignore[arg-type]
    return chart


def test_a_hole_is_compared_with_what_was_seen_there(chart: ChartOf) -> None:
    figures, cells = measured(chart, chart.folder / "tree", None)
    assert list(figures) == ["drive 000.1", "drive 000.2"] and len(set(cells.values())) == 2
    for found in figures.values():
        assert found["psnr"] == pytest.approx(20 * np.log10(255 / 5), abs=0.01)
        assert found["gradient"] == pytest.approx(1.0, abs=0.01) and found["lpips"] is None
    row = row_of(chart, Tree(ROOT, "1234567", "abc"), 9.0, figures, clustered(figures, cells))
    assert row["holes"] == row["cells"] == 2 and row["figures"]["psnr"]["se"] == 0.0
    assert "drive, 1234567: 2 holes in 2 cells, 9 s: psnr 34.151 ±0.000" in row_line(row)


def test_the_network_sees_the_hole_pasted_into_what_was_seen() -> None:
    truth, color = np.full((100, 100, 3), 90, np.uint8), np.full((100, 100, 3), 190, np.uint8)
    part = np.zeros((100, 100), bool)
    part[40:60, 40:60] = True

    def differing(a: np.ndarray, b: np.ndarray) -> float:
        assert a.shape == (64, 64, 3)
        return float((a != b).any(axis=2).sum())

    found = of_hole(truth, color, part, (slice(20, 84), slice(20, 84)), differing)  # type: ignore[arg-type]
    assert found["lpips"] == 400


def test_a_folder_without_a_street_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="Not a workspace"):
        charts_of(tmp_path, "none", [f"street={tmp_path}"])
