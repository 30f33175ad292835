"""Stage ``segment``: the labels that occur, the dynamic objects, and where labels overlook an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.mechanisms import on
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.labels.reading import mask_of
from unveil_core.drives.marked import marked_objects, matte
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.semantics.labels import SceneLabels, find_labels
from unveil_core.semantics.overlooked import overlooked_pixels
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import frame_file, save_mask
from unveil_core.workspace.movers import write_moving

__all__ = ["run"]


def run(context: StageContext) -> Facts:
    """labels.json: which labels occur; movers/: dynamic objects; masks/overlooked: pixels in which labels overlook an object, of
    frames that have such. Returns how many objects are dynamic, and what was assumed."""
    drive = read_imported(context.workspace.drive_dir)
    scene = find_labels(drive)
    write_json_atomic(context.output("labels.json"), scene.labels_json())
    told, seen = _overlooked(context, drive, scene)
    mode, folder = context.settings.movers, context.output("movers")
    by_hand = _said_to_move(context, drive) if mode == "auto" else None
    if by_hand is not None and scene.source != "semantics":
        # Where labels tell nothing, what is said to move stands in for them: its shadows and points are found like any other's.
        drive, told = _masked(context, drive, by_hand)
    count = write_moving(drive, told, folder, mode, context.progress, context.cache, context.kept, by_hand)
    return {"movers": count, **assumed(seen)}


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


def _overlooked(context: StageContext, drive: Drive, scene: SceneLabels) -> tuple[SceneLabels, list[Assumption]]:
    """The labels without those that overlook an object: else it would be taken for one that was not there in those frames."""
    into = context.output("masks/overlooked")
    into.mkdir(parents=True, exist_ok=True)
    # Masks by hand are loose in some frames: what they leave out may be meant so.
    if scene.source != "semantics" or not on("overlooked"):
        return scene, []
    frames, cache = drive.frames, context.cache
    images = cache.frames(len(frames), lambda i: read_image(frames[i].image_path))
    some = 0
    for frame, mask in zip(
        frames, overlooked_pixels(drive, scene, images, cache=cache, progress=context.progress), strict=True
    ):
        if mask.any():
            save_mask(mask, frame_file(into, frame))
            some += 1
    seen = Assumption(
        "labels find an object in each frame that shows it",
        not some,
        f"{some} of {len(frames)} frames overlook one",
        "the labels of other frames decide",
    )
    return replace(scene, overlooked=into), [seen]
