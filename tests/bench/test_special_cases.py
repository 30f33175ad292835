"""The benchmark that switches special cases off: what it patches is there, and what it says is what was found."""

from __future__ import annotations

import argparse
import inspect
import json
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.streets.special_cases import ALL_ON, CASES, FIGURES, change, means, record, stages_from, switched_off
from unveil_core.surfels.initialize import surfels_from_points


def figures(psnr: float, seconds: float) -> dict[str, Any]:
    return {**dict.fromkeys(FIGURES, 0.5), "psnr": psnr, "seconds": dict.fromkeys(stages_from("ground"), seconds)}


@pytest.mark.parametrize("name", CASES)
def test_what_is_switched_off_is_there_and_comes_back(name: str) -> None:
    def now() -> list[Any]:
        return [getattr(import_module(m), f) for m, _, f in (target.partition(":") for target in CASES[name].off)]

    before = now()
    assert all(inspect.isfunction(function) for function in before)
    with switched_off(CASES[name]):
        assert now() == list(CASES[name].off.values())
    assert now() == before and CASES[name].stage in stages_from("ground")


def test_what_stands_in_takes_and_gives_what_the_caller_expects() -> None:
    off = {target.partition(":")[2]: instead for case in CASES.values() for target, instead in case.off.items()}
    points = np.zeros((3, 3))
    surfels = surfels_from_points(points, np.zeros((3, 3), np.uint8), np.zeros(3, np.int64), points + 1, np.ones(3))
    assert len(off["solid_columns"](None, surfels, (2,), [], None)) == 0
    assert off["flush_with_facades"](None, surfels, (2,)).all()
    assert surfels.select(torch.from_numpy(off["flush_with_facades"](None, surfels, ()))).means.shape == (3, 3)
    detail, mask = np.ones((4, 5, 3), np.float32), np.ones((4, 5), bool)
    quilted = off["quilt"](detail, mask, mask, patch=6, search=9)
    assert not off["_beside_what_is_known"](quilted, detail, mask).any()
    found = off["invented_facades"](SimpleNamespace(known=mask), label=2, sh_degree=0)
    assert found.walls is None and found.filled.shape == mask.shape and not found.filled.any()


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
