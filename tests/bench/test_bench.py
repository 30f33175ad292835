"""The benchmarks run, and say what they claim to say; what they find is for benchmarks/results."""

from __future__ import annotations

import json
import time
from pathlib import Path

import cv2
import pytest
import torch

from unveil_core.app.cli import main
from unveil_core.base.errors import UnveilError
from unveil_core.bench.plot import pareto_front
from unveil_core.bench.raster import Plan, bench_raster, write_plot
from unveil_core.bench.rivals import GsplatReference, Yardstick, gsplat_is_there
from unveil_core.bench.scenes import corridor, corridor_camera
from unveil_core.bench.timing import alternate
from unveil_core.raster.api import render

TINY = Plan(
    size=(32, 32), count=150, rounds=1, counts=(80,), sizes=((32, 16),), tiles=1, small=(16, 16), small_count=30
)


def test_front_holds_what_nothing_beats() -> None:
    points = [
        ("slow and right", 9.0, 1e-6),
        ("fast and wrong", 1.0, 1e-1),
        ("beaten", 5.0, 1e-1),
        ("between", 4.0, 1e-3),
    ]
    assert [p[0] for p in pareto_front(points)] == ["fast and wrong", "between", "slow and right"]


def test_alternating_gives_medians_and_ratios() -> None:
    seen: list[str] = []
    measured = alternate(
        {"a": lambda: seen.append("a"), "b": lambda: (seen.append("b"), time.sleep(0.05))}, rounds=3, base="a"
    )
    assert seen == ["a", "b"] * 4
    assert measured["a"]["ratio"] == 1.0
    assert measured["b"]["ms"] > 49 and measured["b"]["ratio"] > 1


def test_corridor_is_a_street() -> None:
    surfels = corridor(5000, degree=1)
    assert len(surfels) == 5000 and surfels.sh.shape == (5000, 4, 3)
    assert set(surfels.labels.tolist()) == set(range(8))
    torch.testing.assert_close(surfels.quats.norm(dim=1), torch.ones(5000))
    out = render(surfels, corridor_camera(96, 64), ("alpha", "normal"))
    assert out.alpha is not None and out.normal is not None
    assert 0.7 < float(out.alpha.mean()) < 1
    # The road fills the foot of the picture, and its normals point up: against y.
    assert float(out.normal[-8:, 40:56, 1].mean()) < -0.8


def test_raster_tables_tell_times_and_errors(tmp_path: Path) -> None:
    measured = bench_raster(TINY)
    rows = {row["name"]: row for row in measured["knobs"]["forward_and_backward"]}
    assert rows["specified, all planes"]["gradient_error"] < 1e-4
    assert rows["exponential of degree 3"]["gradient_error"] > rows["specified, all planes"]["gradient_error"]
    assert rows["cut at alpha 1/32"]["plane_error"] > 100 * rows["specified, all planes"]["plane_error"]
    assert rows["whole boxes, no exact reach"]["plane_error"] == rows["specified, all planes"]["plane_error"]
    assert all(row["ms"] > 0 for row in rows.values())
    assert measured["sweep"][0]["surfels"] == 80 and measured["sweep"][0]["plane_error"] < 1e-3
    assert any("plain torch" in row["name"] for row in measured["rivals"])
    json.dumps(measured)
    write_plot(measured, tmp_path / "front.png")
    picture = cv2.imread(str(tmp_path / "front.png"))
    assert picture is not None and picture.shape[0] > 400


def test_command_measures_a_step_and_writes_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "step.json"
    assert main(["bench", "step", "--size", "48x32", "--surfels", "300", "-o", str(target)]) == 0
    measured = json.loads(target.read_text())
    assert measured["surfels"] == 300 and measured["size"] == [48, 32]
    assert (
        0 < measured["least_ms"] <= measured["step_ms"] and measured["second_process_s"] > 0 and "ratio" not in measured
    )
    assert '"step_ms"' in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [["bench", "raster", "--size", "wide"], ["bench", "everything"]])
def test_wrong_usage_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_yardstick_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UnveilError, match=r"raster\.cpp"):
        Yardstick(tmp_path)
    assert main(["bench", "step", "--yardstick", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert str(tmp_path) in error and len(error.strip().splitlines()) == 1


@pytest.mark.skipif(not gsplat_is_there(), reason="gsplat is not installed; it is an optional rival")
def test_gsplats_reference_paints_the_same_street() -> None:
    surfels, view = corridor(800), corridor_camera(64, 48)
    ours = render(surfels, view, ("rgb",)).rgb
    theirs = GsplatReference(surfels, view).run(torch.ones(48, 64, 3))
    assert ours is not None
    # They let an alpha reach 0.999, not 0.99.
    assert float((ours - theirs).abs().median()) < 2e-3
