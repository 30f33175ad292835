"""The bench of real drives: its statistics, its choice of places, and what it takes from its cache."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_drives.measured import Measured, hidden_psnr, means_of
from benchmarks.real_drives.paired import estimate, paired
from benchmarks.real_drives.places import Feature, choose_rounds
from benchmarks.real_drives.real import comparison_lines, recorded, row_of, table, whole_drive
from benchmarks.real_drives.table import DRIVES, named
from benchmarks.real_drives.trees import Tree, run_key, run_once, tree_at, without
from docs.generate import ROOT
from unveil_core.evaluate.holdout.placement import Place
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar

# -------------------------------------------------------------------------------------------------------------- statistics


def test_a_mean_has_the_error_of_what_was_measured() -> None:
    found = estimate([1.0, 2.0, None, 3.0, math.nan, math.inf])
    assert found is not None and (found.mean, found.count) == (2.0, 3)
    assert found.se == pytest.approx(1 / math.sqrt(3))
    assert estimate([None]) is None
    single = estimate([4.0])
    assert single is not None and single.to_json() == {"mean": 4.0, "se": None, "count": 1}


def test_differences_are_taken_car_by_car() -> None:
    ours = {"1": {"psnr": 25.0, "lpips": 0.2}, "2": {"psnr": 15.0, "lpips": None}, "3": {"psnr": 9.0}}
    theirs = {"1": {"psnr": 24.0, "lpips": 0.3}, "2": {"psnr": 14.5, "lpips": 0.1}, "4": {"psnr": 0.0}}
    found = paired(ours, theirs)
    assert found["psnr"].mean == 0.75 and found["psnr"].se == pytest.approx(0.25) and found["psnr"].count == 2
    assert found["lpips"].count == 1 and math.isnan(found["lpips"].se)
    assert paired(ours, {}) == {}


# ------------------------------------------------------------------------------------------------------------------ places


def place(s: float, t: float, share: float = 0.05, value: float = 1.0) -> Place:
    car = VirtualCar(np.array([s, t, 0.0]), np.eye(3), 1, s, t)
    return Place(car, value, np.arange(3), np.full(3, share))


def chosen_of(places: list[Place], levels: list[float], **limits: int) -> list[list[tuple[float, float]]]:
    features = [Feature(p.car.s, p.car.t, level, float(p.shares[0])) for p, level in zip(places, levels, strict=True)]
    found = choose_rounds(places, features, frames=3, **limits)
    assert all([car.number for car in cars] == list(range(1, len(cars) + 1)) for cars in found)
    return [[(car.s, car.t) for car in cars] for cars in found]


def test_the_next_place_is_the_one_least_like_the_others() -> None:
    places = [place(10, 3), place(16, 3), place(22, 3), place(10, -3)]
    # The one in the sun before the one further along, and that of the other side before both.
    assert chosen_of(places, [60, 200, 60, 60], wanted=3, each=6, rounds=1) == [[(10, 3), (16, 3), (10, -3)]]


def test_a_round_is_filled_before_the_next_one_begins() -> None:
    close = [place(10, 3), place(13, 3), place(16, 3), place(10.5, 3)]
    found = chosen_of(close, [60] * 4, wanted=4, each=6, rounds=2)
    # 5.5 m apart at one time; the last is the same hole as the first.
    assert found == [[(10, 3), (16, 3)], [(13, 3)]]
    assert chosen_of(close, [60] * 4, wanted=4, each=1, rounds=1) == [[(10, 3)]]
    large = [place(10, 3, share=0.3), place(30, 3, share=0.3)]
    assert chosen_of(large, [60] * 2, wanted=2, each=6, rounds=2) == [[(10, 3)], [(30, 3)]]


# ------------------------------------------------------------------------------------------------------------------- cache


def test_a_tree_is_known_by_the_code_that_a_run_runs() -> None:
    tree = tree_at(ROOT)
    assert len(tree.digest) == 12 and tree.root == ROOT.resolve()
    with pytest.raises(SystemExit, match="Not a checkout"):
        tree_at(ROOT / "docs")


def test_a_run_is_not_repeated_and_one_that_fails_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "runs" / run_key("abc", "draft")).mkdir(parents=True)
    mark = tmp_path / "runs" / run_key("abc", "draft") / "run.json"
    mark.write_text(json.dumps({"seconds": 12.5, "load": 1.0}))
    tree = Tree(ROOT, "1234567", "abc")
    kept = run_once(tree, tmp_path / "drive", tmp_path / "runs", "draft", [])
    assert kept.seconds == 12.5 and kept.workspace == mark.parent / "workspace"
    with pytest.raises(RuntimeError, match="exit 2: .*drive"):
        run_once(replace(tree, digest="other"), tmp_path / "drive", tmp_path / "runs", "draft", [])
    assert not (tmp_path / "runs" / run_key("other", "draft") / "run.json").exists()


def test_a_run_without_a_mechanism_is_another_and_goes_on_from_the_whole_one(tmp_path: Path) -> None:
    tree = Tree(ROOT, "1234567", "abc")
    less = without(tree, ["quilting", "sun"])
    assert (less.name, less.off) == ("1234567 without quilting,sun", ("quilting", "sun")) and less.digest != tree.digest
    whole = tmp_path / "runs" / run_key(tree.digest, "draft")
    (whole / "workspace").mkdir(parents=True)
    (whole / "workspace" / "begun.txt").write_text("with all")
    (whole / "run.json").write_text(json.dumps({"seconds": 3.0, "load": 0.5}))
    with pytest.raises(RuntimeError, match="exit 2"):  # there is no such drive, and that is no workspace
        run_once(less, tmp_path / "drive", tmp_path / "runs", "draft", [])
    folder = tmp_path / "runs" / run_key(less.digest, "draft")
    assert (folder / "workspace" / "begun.txt").is_file()


def test_drives_have_names_and_settings() -> None:
    assert named("") == list(DRIVES) and [d.name for d in named("lund,kitti_0005")] == ["lund", "kitti_0005"]
    with pytest.raises(SystemExit, match="Unknown drive: paris"):
        named("paris")
    settings = named("nuscenes_0916_front")[0].settings(Path("/data"), "draft")
    assert settings.labels == "/data/nuscenes/labels" and settings.sweeps == "key" and settings.quality == "draft"


# ----------------------------------------------------------------------------------------------------------------- results


def measured(psnr: float) -> Measured:
    def methods(value: float) -> dict[str, dict[str, float]]:
        return {"ours": {"psnr": value, "lpips": 0.2}, "telea": {"psnr": 15.0}, "shift_map": {"psnr": 16.0}}

    cars = [{"number": n, "regions": {"removed": {"pixels": 9, "methods": methods(psnr + n)}}} for n in (1, 2)]
    found = {"cars": cars, "outside": {"changed": 0.01, "mean": 3.0}, "flicker": {"methods": {}}}
    return Measured(found, found, 21.5, {"reconstruct": 60.0}, 90.0, 1.0)


def test_a_row_has_means_over_the_cars_of_all_rounds() -> None:
    row = means_of([measured(20.0), measured(22.0)])
    ours = row["parts"]["removed"]["ours"]
    assert ours["psnr"] == {"mean": 22.5, "se": pytest.approx(0.6455), "count": 4} and ours["lpips"]["mean"] == 0.2
    assert row["parts"]["removed"]["best_opencv_is"] == "shift_map" and row["parts"]["unseen"]["best_opencv"] is None
    assert row["parts"]["removed"]["gain"] == {"psnr": {"mean": 6.5, "se": pytest.approx(0.6455), "count": 4}}
    assert row["of_drive"]["hidden psnr"] == 21.5 and row["of_drive"]["all s"] == 90.0
    assert list(row["cars"]) == ["1.1", "1.2", "2.1", "2.2"]
    told = row_of(DRIVES[0], Tree(ROOT, "1234567", "abc"), "standard", [measured(20.0), measured(22.0)])
    assert told["drive"] == DRIVES[0].name and told["load_before"] == [1.0, 1.0]
    lines = "\n".join(table([told]))
    assert "kitti_0005, standard, 1234567 (abc)" in lines and "psnr 22.500 ±0.645" in lines and "all s 90.0" in lines


def test_rows_of_the_same_code_are_replaced() -> None:
    row = {"drive": "a", "quality": "standard", "digest": "y", "n": 1}
    comparison = {"drive": "a", "quality": "standard", "ours_digest": "y", "theirs_digest": "z"}
    document = recorded({}, [row], [comparison])
    document = recorded(document, [row | {"n": 2}, row | {"digest": "w"}], [comparison])
    assert [r["n"] for r in document["runs"]] == [2, 1] and len(document["comparisons"]) == 1


def test_a_comparison_says_of_how_many_cars() -> None:
    figures = {"removed psnr": {"mean": 0.5, "se": 0.1, "count": 6}}
    lines = comparison_lines({"drive": "a", "quality": "draft", "ours": "x", "theirs": "y", "figures": figures})
    assert lines[0] == "a, draft: x minus y" and lines[1].endswith("0.500 ±0.100  of 6 cars")


def test_a_whole_drive_is_compared_without_an_error() -> None:
    rows = [{"of_drive": {"hidden psnr": 20.5, "all s": None}}, {"of_drive": {"hidden psnr": 20.0, "all s": 9.0}}]
    assert whole_drive(rows) == {"hidden psnr": 0.5}


def test_the_last_look_of_the_fine_phase_counts() -> None:
    looks = [{"phase": "coarse", "psnr": 30.0}, {"phase": "fine", "psnr": 20.0}, {"phase": "fine", "psnr": 21.0}]
    assert hidden_psnr({"reconstruct": {"choices": {"looks": looks}}}) == 21.0
    assert hidden_psnr({"reconstruct": {}}) is None and hidden_psnr({}) is None
