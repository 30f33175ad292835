"""The benchmark that switches special cases off: what it lists, and what the page says is what was found."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.special_cases import (
    ALL_ON,
    FIGURES,
    RESULTS,
    change,
    listed,
    means,
    measured_cases,
    record,
    stages_from,
)
from docs.generate import ROOT
from unveil_core.pipeline.mechanisms import MECHANISMS


def figures(psnr: float, seconds: float) -> dict[str, Any]:
    return {**dict.fromkeys(FIGURES, 0.5), "psnr": psnr, "seconds": dict.fromkeys(stages_from("ground"), seconds)}


def test_all_mechanisms_are_listed_with_their_lines() -> None:
    rows = {line.split()[1]: int(line.split()[0]) for line in listed()}
    assert set(rows) == set(MECHANISMS) and list(rows.values()) == sorted(rows.values(), reverse=True)
    assert rows["sun"] > rows["houses"] > rows["houses_beyond"] > 20
    assert set(measured_cases()) == {n for n, m in MECHANISMS.items() if m.stage not in ("segment", "reconstruct")}


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


def test_what_the_page_says_is_in_the_file() -> None:
    document = json.loads(RESULTS.read_text())
    rows, runs = document["means"]["standard"], document["runs"]["standard"]
    page = (ROOT / "docs/benchmarks.md").read_text(encoding="utf-8")
    section = page.partition("\n## Special cases\n")[2].partition("\n## ")[0]
    told = {m[1]: m[2].split(" | ") for m in re.finditer(r"^\| `(\w+)` \| (.*) \|$", section, flags=re.MULTILINE)}
    assert set(told) == set(rows)

    def signed(value: float, digits: int) -> str:
        text = f"{value:+.{digits}f}"
        return text if float(text) else text[1:]

    for case, (_, *cells) in told.items():
        found, by_seed = rows[case], {seed: of[case]["change"]["psnr"] for seed, of in runs.items() if case in of}
        most = min(by_seed, key=lambda seed: by_seed[seed])
        others = np.mean([value for seed, value in by_seed.items() if seed != most])
        assert cells == [
            f"{signed(found['psnr'], 2)} dB",
            f"{signed(100 * found['line_recall'], 1)} / {signed(100 * found['false_lines'], 1)}",
            f"{found['changed']} of {found['streets']}",
            f"{signed(by_seed[most], 2)} dB, on {most}",
            f"{signed(float(others), 2)} dB",
        ]
    lines = (
        section.partition("With everything on, in the state of that day, ")[2].partition(".\n")[0].replace(" has", "")
    )
    shown = re.findall(r"(\d+) (\d+\.\d)(?: dB)?", re.sub(r"\([^)]*\)", "", " ".join(lines.split())))
    assert shown == [(seed, f"{of[ALL_ON]['psnr']:.1f}") for seed, of in runs.items()]
