"""Stage ``report``: figures and the page."""

from __future__ import annotations

from pathlib import Path

from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import run_evaluation, write_metrics
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.report import write_report
from unveil_core.workspace.workspace import Workspace

__all__ = ["STAGE"]


def run(context: StageContext) -> None:
    """metrics.json and report/."""
    metrics = run_evaluation(context.workspace.root, None, context.progress, kept=context.kept)
    write_metrics(metrics, context.output("metrics.json"))
    write_report(context.workspace.root, context.output("report"), metrics, context.progress)


def files_of_truth(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """The true empty street, where the drive has one."""
    truth = read_imported(workspace.drive_dir, points=False).truth_root
    if truth is None or not truth.is_dir():
        return []
    return [(p.relative_to(truth).as_posix(), p) for p in sorted(truth.rglob("*")) if p.is_file()]


STAGE = Stage(
    "report",
    run,
    inputs=(
        "drive",
        "clean",
        "frames",
        "renders",
        "inpainted",
        "masks",
        "regions",
        "provenance",
        "certainty",
        "instances.json",
        "instances",
        "meshes/full.ply",
        "meshes/empty.ply",
        "meshes/empty.glb",
        "surfels/empty.ply",
        "surfels/sky.npz",
    ),
    outputs=(
        "metrics.json",
        "report",
    ),
    outside=files_of_truth,
)
