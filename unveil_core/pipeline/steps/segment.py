"""Stage ``segment``: the labels that occur, and the dynamic objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.labels.reading import mask_of
from unveil_core.drives.marked import marked_objects, matte
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.semantics.labels import SceneLabels, find_labels
from unveil_core.workspace.files import frame_file
from unveil_core.workspace.movers import write_moving

__all__ = ["run"]


def run(context: StageContext) -> Facts:
    """labels.json: which labels occur; movers/: dynamic objects. Returns how many objects are dynamic."""
    drive = read_imported(context.workspace.drive_dir)
    scene = find_labels(drive)
    write_json_atomic(context.output("labels.json"), scene.labels_json())
    mode, folder = context.settings.movers, context.output("movers")
    by_hand = _said_to_move(context, drive) if mode == "auto" else None
    if by_hand is not None and scene.source != "semantics":
        # Where labels tell nothing, what is said to move stands in for them: its shadows and points are found like any other's.
        drive, scene = _masked(context, drive, by_hand)
    count = write_moving(drive, scene, folder, mode, context.progress, context.cache, context.kept, by_hand)
    return {"movers": count}


def _said_to_move(context: StageContext, drive: Drive) -> Sequence[Mask] | None:
    """(H, W) per frame, pixels of marked objects that move; None where there are none."""
    marks = [m for m in marked_objects(context.settings.marked) if m.moves]
    if not marks:
        return None

    def of_frame(v: int) -> Mask:
        frame = drive.frames[v]
        found = np.zeros((frame.camera.height, frame.camera.width), dtype=bool)
        for mark in marks:
            if (own := matte(mark, drive, frame)) is not None:
                found |= own
        return found

    return context.cache.frames(len(drive.frames), of_frame)


def _masked(context: StageContext, drive: Drive, moving: Sequence[Mask]) -> tuple[Drive, SceneLabels]:
    """The drive with masks of what moves beside its own, and its labels by them."""
    folder, frames = context.scratch("moving"), []
    for frame, mask in zip(drive.frames, moving, strict=True):
        removed = mask | mask_of(frame) if frame.mask_path is not None else mask
        path = frame_file(folder, frame)
        write_image_atomic(path, np.where(removed, 0, 255).astype(np.uint8))
        frames.append(replace(frame, mask_path=path))
    masked = replace(drive, frames=tuple(frames))
    return masked, find_labels(masked)
