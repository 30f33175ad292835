"""Stage ``segment``: the labels that occur, the dynamic objects, and where labels overlook an object."""

from __future__ import annotations

from dataclasses import replace

from unveil_core.base.files import write_json_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
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
    count = write_moving(drive, told, folder, mode, context.progress, context.cache, context.kept)
    return {"movers": count, **assumed(seen)}


def _overlooked(context: StageContext, drive: Drive, scene: SceneLabels) -> tuple[SceneLabels, list[Assumption]]:
    """The labels without those that overlook an object: else it would be taken for one that was not there in those frames."""
    into = context.output("masks/overlooked")
    into.mkdir(parents=True, exist_ok=True)
    if scene.source != "semantics":  # masks by hand are loose in some frames: what they leave out may be meant so
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
        "the other frames tell what is there",
    )
    return replace(scene, overlooked=into), [seen]
