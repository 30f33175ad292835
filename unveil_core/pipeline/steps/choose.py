"""Stage ``choose``: what is removed. Apart from ``segment``, so that another choice does not make the scene again."""

from __future__ import annotations

from unveil_core.base.files import write_json_atomic
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import marked_ids
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.semantics.labels import SceneLabels, choose_labels, has_labels
from unveil_core.semantics.too_much import MUCH
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import known_objects

__all__ = ["run"]


def run(context: StageContext) -> Facts:
    """selection.json: what is removed. It is no part of labels.json, so that another choice does not make the scene again."""
    drive = read_imported(context.workspace.drive_dir, points=False)
    settings = context.settings
    instances = settings.instances or (() if settings.remove or has_labels(drive) else marked_ids(settings.marked))
    scene = choose_labels(drive, settings.remove, instances, known=known_objects(context.workspace))
    write_json_atomic(context.output("selection.json"), scene.selection_json())
    return assumed([_much_left(scene)] if scene.removed else [])


def _much_left(scene: SceneLabels) -> Assumption:
    """That most of what was photographed stays. Of labels in files it was asked before the import; those that the import made, from
    boxes, points or by a network, are known only now."""
    share = sum(scene.pixel_counts[i] for i in scene.removed_labels) / max(sum(scene.pixel_counts), 1)
    return Assumption(
        "what is removed is less than half of what was photographed",
        share <= MUCH,
        f"{100 * share:.0f} % is {', '.join(scene.removed)}",
        "it is removed all the same: look at masks/removed, choose with --remove",
    )
