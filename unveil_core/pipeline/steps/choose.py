"""Stage ``choose``: what is removed. Apart from ``segment``, so that another choice does not make the scene again."""

from __future__ import annotations

from unveil_core.base.files import write_json_atomic
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.stage import StageContext
from unveil_core.semantics.labels import choose_labels
from unveil_core.workspace.files import known_objects

__all__ = ["run"]


def run(context: StageContext) -> None:
    """selection.json: what is removed. It is no part of labels.json, so that another choice does not make the scene again."""
    drive = read_imported(context.workspace.drive_dir, points=False)
    settings = context.settings
    scene = choose_labels(drive, settings.remove, settings.instances, known=known_objects(context.workspace))
    write_json_atomic(context.output("selection.json"), scene.selection_json())
