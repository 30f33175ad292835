"""Stage ``report``: figures and the page."""

from __future__ import annotations

from unveil_core.evaluate import run_evaluation, write_metrics
from unveil_core.pipeline.stage import StageContext
from unveil_core.report import write_report

__all__ = ["run"]


def run(context: StageContext) -> None:
    """metrics.json and report/."""
    root, baselines = context.workspace.root, context.settings.baselines
    metrics = run_evaluation(root, None, context.progress, baselines=baselines, kept=context.kept)
    write_metrics(metrics, context.output("metrics.json"))
    write_report(context.workspace.root, context.output("report"), metrics, context.progress)
