"""What the benchmark of streets by seed makes of its rows."""

from __future__ import annotations

import copy
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.streets.street_figures import (
    GROUPS,
    SEEN,
    UNSEEN_FROM,
    group_of,
    may_be_shown,
    plot,
    recorded,
    summarized,
)
from benchmarks.streets.streets import SHEET_ROWS, picture_file, sheet_rows, write_sheet
from docs.generate import ROOT
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.bench.timing import program_commit

GENERATOR = "0a1b2c3d"


def row(psnr: float, generator: str = GENERATOR) -> dict[str, Any]:
    """A row as a run gives it, with what the means need."""
    figures = {"psnr": psnr, "ssim": 0.7, "gradient": None, "line_recall": 0.5, "false_lines": 0.1, "residue": 0.0}
    return {
        "generator": generator,
        "removed": figures,
        "best_opencv": {"row": "telea", **figures, "psnr": psnr - 6},
        "flicker": {"ours": 2.0},
        "outside": {"changed_share": 0.0},
        "seconds": 100.0,
        "peak_memory_mb": 1000.0,
    }


def taken(rows: list[tuple[int, dict[str, Any]]]) -> dict[str, Any]:
    """A document with rows recorded one after the other."""
    document: dict[str, Any] = {"runs": {}, "means": {}}
    for seed, of in rows:
        recorded(document, "standard", seed, of)
    return document


def test_a_later_run_leaves_the_first_look_as_it_was() -> None:
    document = taken([(46, row(20.0)), (46, row(26.0)), (29, row(24.0))])
    assert list(document["runs"]["standard"]) == list(document["first_looks"]["standard"]) == ["29", "46"]
    assert document["runs"]["standard"]["46"]["removed"]["psnr"] == 26.0
    assert document["first_looks"]["standard"]["46"]["removed"]["psnr"] == 20.0
    means = summarized(document, "standard", GENERATOR)["means"]["standard"]
    assert means["first_look"]["28 on"]["removed"]["psnr"] == 22.0
    assert means["latest"]["28 on"]["removed"]["psnr"] == 25.0


def test_a_seed_that_was_looked_at_gets_no_first_look_but_keeps_its_own() -> None:
    document = taken([(3, row(20.0)), (12, row(20.0)), (min(SEEN), row(21.0))])
    assert document["first_looks"]["standard"] == {}
    document["first_looks"]["standard"] = {"10": row(15.0), str(min(SEEN)): row(17.0)}
    before = copy.deepcopy(document["first_looks"])
    recorded(document, "standard", 10, row(25.0))
    assert document["first_looks"] == before
    means = summarized(document, "standard", GENERATOR)["means"]["standard"]
    assert means["first_look"]["10-19"]["removed"]["psnr"] == 15.0
    assert means["first_look"]["28 on"]["lowest"] == 17.0  # the bad ones count
    assert "20-27" not in means["first_look"] and set(means["latest"]) == {"0-9", "10-19", "28-33", "28 on"}


def test_another_generator_draws_another_street() -> None:
    document = taken([(92, row(20.0, "old")), (93, row(22.0))])
    assert summarized(document, "standard", GENERATOR)["means"]["standard"]["first_look"]["92 on"]["streets"] == 1
    recorded(document, "standard", 92, row(18.0))
    assert document["first_looks"]["standard"]["92"]["removed"]["psnr"] == 18.0


def test_means_are_over_what_was_measured() -> None:
    failed = {"generator": GENERATOR, "error": "killed", "seconds": 9.0, "peak_memory_mb": 1.0}
    sunny = {**row(23.0), "cast_shadow": {"psnr": 19.0}}
    document = taken([(28, row(21.0)), (29, failed), (31, sunny)])
    found = summarized(document, "standard", GENERATOR)["means"]["standard"]["first_look"]["28 on"]
    assert (found["streets"], found["failed"], found["seconds"]) == (3, 1, 100.0)
    assert found["removed"]["psnr"] == 22.0 and found["removed"]["gradient"] is None
    assert found["cast_shadow"]["psnr"] == 19.0 and found["lowest"] == 21.0
    assert found["gain_over_best_opencv_db"] == 6.0 and found["ahead_of_best_opencv"] == 2
    assert found["flicker"] == {"ours": 2.0, "truth": None, "telea": None, "shift_map": None}


def test_rows_of_before_the_spectrum_have_no_say_in_its_mean() -> None:
    new = row(22.0)
    new["removed"] = {**new["removed"], "spectrum_4px": 0.8}
    found = summarized(taken([(28, row(21.0)), (29, new)]), "standard", GENERATOR)["means"]["standard"]["first_look"]
    assert (found["28 on"]["removed"]["spectrum_4px"], found["28 on"]["removed"]["psnr"]) == (0.8, 21.5)
    assert found["28 on"]["best_opencv"]["spectrum_4px"] is None


def test_pictures_of_held_out_seeds_are_not_shown() -> None:
    assert all(may_be_shown(seed) for seed in (0, 9, 10, UNSEEN_FROM - 1, *SEEN))
    assert not any(may_be_shown(seed) for seed in (28, 29, 31, 32, 37, 46, 1000))
    assert [group_of(seed) for seed in (0, 19, 27, 28, 45, 46, 99)] == list(GROUPS)[:4] + ["40-45", "46-51", "92 on"]


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    for command in (
        ["init", "-q"],
        ["config", "user.email", "nobody@example.org"],
        ["config", "user.name", "Nobody"],
        ["commit", "-q", "--allow-empty", "-m", "Begin"],
    ):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    for name in ("benchmarks/results/row.json", "code.py"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1")
    subprocess.run(["git", "-C", str(tmp_path), "add", "."], check=True)
    subprocess.run(["git", "-C", str(tmp_path), "commit", "-q", "-m", "Go on"], check=True)
    return tmp_path


def test_the_commit_tells_when_the_program_is_not_the_commits(repository: Path, tmp_path_factory: Any) -> None:
    clean = program_commit(repository)
    assert clean is not None and clean.isalnum() and len(clean) >= 7
    (repository / "benchmarks/results/row.json").write_text("2")
    assert program_commit(repository) == clean
    (repository / "code.py").write_text("2")
    assert program_commit(repository) == clean + "+"
    assert program_commit(tmp_path_factory.mktemp("nowhere")) is None


# ------------------------------------------------------------------------------------------------------------- what docs say


def test_the_page_of_the_generator_names_the_list_of_seeds_that_were_looked_at() -> None:
    page = " ".join((ROOT / "sample_scenes/generators/streets/README.md").read_text(encoding="utf-8").split())
    assert "`SEEN` in `benchmarks/streets/street_figures.py`" in page and f"0 to {UNSEEN_FROM - 1} are for work" in page


# ----------------------------------------------------------------------------------------------------------------- pictures


def test_the_plot_takes_many_seeds_and_leaves_out_what_failed(tmp_path: Path) -> None:
    rows = {str(seed): row(15.0 + seed % 9) for seed in range(50)}
    rows["50"] = {"generator": GENERATOR, "error": "killed"}
    plot(rows, tmp_path / "many.png", "streets")
    plot({"3": row(20.0)}, tmp_path / "one.png", "streets")
    many, one = (read_image(tmp_path / f"{name}.png") for name in ("many", "one"))
    assert many.shape[1] > one.shape[1] and many.std() > 10
    plot({"50": rows["50"]}, tmp_path / "none.png", "streets")
    assert not (tmp_path / "none.png").exists()


def test_the_sheet_keeps_pictures_of_other_calls_and_shows_no_held_out_seed(tmp_path: Path) -> None:
    rows = {str(seed): row(20.0 + seed / 10) for seed in range(40)}
    for seed in (*range(2, 20), 29, 30):  # the picture of 29 must not be there, but may
        picture = np.full((8, 24, 3), 5 * seed, np.uint8)
        write_image_atomic(picture_file(seed, tmp_path, "standard"), picture)
    rows["30"]["removed"]["psnr"] = 3.0
    found = sheet_rows(rows, tmp_path, "standard")
    shown = [round(float(picture.mean()) / 5) for picture in found]
    assert shown == [30, *range(2, 1 + SHEET_ROWS)]
    assert sheet_rows(rows, tmp_path, "draft") == []
    write_sheet(found, tmp_path / "sheet.jpg")
    assert read_image(tmp_path / "sheet.jpg").shape == (8 * SHEET_ROWS, 24, 3)
