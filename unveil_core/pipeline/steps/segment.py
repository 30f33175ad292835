"""Stage ``segment``: the labels that occur, and the dynamic objects."""

from __future__ import annotations

from unveil_core.base.files import write_json_atomic
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.semantics.labels import find_labels
from unveil_core.workspace.movers import write_moving

__all__ = ["run"]


def run(context: StageContext) -> Facts:
    """labels.json: which labels occur; movers/: dynamic objects."""
    drive = read_imported(context.workspace.drive_dir)
    scene = find_labels(drive)
    write_json_atomic(context.output("labels.json"), scene.labels_json())
    mode, folder = context.settings.movers, context.output("movers")
    count = write_moving(drive, scene, folder, mode, context.progress, context.cache, context.kept)
    return {"movers": count}
