"""The benchmark that switches special cases off: what it lists, and what the page says is what was found."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.streets import special_cases
from benchmarks.streets.special_cases import (
    ALL_ON,
    FIGURES,
    FIRST,
    change,
    listed,
    means,
    record,
    stages_from,
)
from unveil_core.pipeline.mechanisms import MECHANISMS

PROGRAM = special_cases.__file__


def figures(psnr: float, seconds: float) -> dict[str, Any]:
    return {**dict.fromkeys(FIGURES, 0.5), "psnr": psnr, "seconds": dict.fromkeys(stages_from("ground"), seconds)}


def test_all_mechanisms_are_listed_with_their_lines() -> None:
    rows = {line.split()[1]: int(line.split()[0]) for line in listed()}
    assert set(rows) == set(MECHANISMS) and list(rows.values()) == sorted(rows.values(), reverse=True)
    assert rows["sun"] > rows["houses"] > rows["houses_beyond"] > 20
    assert [name for name, lines in rows.items() if not lines] == []
    assert rows["ground_by_photographs"] > 300


def test_each_mechanism_is_measured_from_its_own_stage_on() -> None:
    names = stages_from(FIRST)
    for mechanism in MECHANISMS.values():
        assert mechanism.stage in names
        assert stages_from(mechanism.stage) == names[names.index(mechanism.stage) :]
    told = subprocess.run(
        [sys.executable, PROGRAM, "--cases", "ground_by_photographs,nothing"], capture_output=True, text=True
    )
    assert "unknown case nothing: use ground_by_photographs, " in told.stderr


def test_changes_are_without_minus_with_and_of_the_stages_that_ran_again() -> None:
    base, without = figures(22.0, 10.0), figures(21.5, 8.0)
    without["line_recall"] = None
    stages = stages_from("inpaint")
    assert stages[0] == "inpaint" and stages[-1] == "deliver" and "mesh" not in stages
    found = change(without, base, stages)
    assert found["psnr"] == -0.5 and found["line_recall"] is None
    assert found["seconds"] == -2.0 * len(stages)


def test_means_count_the_streets_that_changed(tmp_path: Path) -> None:
    arguments = argparse.Namespace(output=tmp_path / "special.json", quality="draft")
    base = figures(22.0, 10.0)
    for seed, psnr in ((2, 21.0), (3, 22.0)):
        row = figures(psnr, 10.0)
        record(arguments, seed, ALL_ON, base)
        record(arguments, seed, "facades", {**row, "change": change(row, base, ["inpaint"])})
    document = json.loads(arguments.output.read_text())
    found = document["means"]["draft"]["facades"]
    assert (found["streets"], found["changed"], found["psnr"], found["seconds"]) == (2, 1, -0.5, 0.0)
    assert "houses" not in document["means"]["draft"] and means({}) == {}
    record(arguments, 2, ALL_ON, base)  # the same again: what was compared with it stays
    assert set(json.loads(arguments.output.read_text())["runs"]["draft"]["2"]) == {ALL_ON, "facades"}
    record(arguments, 2, ALL_ON, figures(23.0, 10.0))
    assert set(json.loads(arguments.output.read_text())["runs"]["draft"]["2"]) == {ALL_ON}
