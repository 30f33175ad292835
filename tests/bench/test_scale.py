"""What the benchmark of long drives says of the frames, against the evaluation."""

from __future__ import annotations

import shutil
from pathlib import Path

from benchmarks.machine.scale import details, errors, psnr
from tests.evaluate.street_workspace import build_workspace
from unveil_core.evaluate import run_evaluation
from unveil_core.evaluate.detail.scores import DETAIL_FIGURES


def test_figures_are_those_of_the_evaluation(tmp_path: Path) -> None:
    workspace, truth = build_workspace(tmp_path), tmp_path / "truth"
    # As a street of boxes has it: no more than the true pictures, so that the run's masks tell where to look.
    shutil.copytree(tmp_path / "drive_on_disk/truth/images", truth / "images/front")
    ours = run_evaluation(workspace, truth, baselines=False)["truth"]["regions"]["removed"]["methods"]["ours"]
    found = details(workspace, truth)
    assert found == {name: ours[name] for name in DETAIL_FIGURES}
    assert found["gradient"] is not None and found["line_recall"] is not None
    assert abs((psnr(*errors(workspace, truth / "images", "frames")) or 0.0) - ours["psnr"]) < 1e-3
