"""Stage ``remove``: which surfels and pixels go, and what of the street behind them nobody saw."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.base.mechanisms import on
from unveil_core.base.parallel import each
from unveil_core.base.pictures.levels import as_bytes
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import marked_objects
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.files import read_ground
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.remove.behind import empty_street
from unveil_core.remove.object_pixels import ObjectPixels, drawn_by_kind
from unveil_core.remove.observed import SeenView, SeenViews, never_seen
from unveil_core.remove.reaching import shortened
from unveil_core.remove.regions import region_map
from unveil_core.remove.remains import remains
from unveil_core.remove.removal import removed_surfels
from unveil_core.remove.selection import LONGEST_M, WIDEST_M
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.instances import Box
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import NOT_SHORTENED, SceneEdit, write_edit
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import frame_file, listed_objects, load_array, load_selection, save_mask
from unveil_core.workspace.movers import ego_pixels, read_moving

__all__ = ["run"]

MOST_NAMED = 5
"""So many objects are named in a line of the log."""


def _vehicles_assumed(boxes: dict[int, Box], names: dict[int, str]) -> Assumption:
    """That boxes are those of single vehicles.

    Args:
        boxes: by id, those that are not; names: of objects' classes, by id.
    """
    told = []
    for number, box in sorted(boxes.items(), key=lambda entry: -max(entry[1].size[:2])):
        length, width = max(box.size[:2]), min(box.size[:2])
        why = "" if length > LONGEST_M else f" and {width:.1f} m wide" if width > WIDEST_M else " with a gap"
        told.append(f"{names.get(number, 'object')} {number}: {length:.1f} m long{why}")
    more = f", and {len(told) - MOST_NAMED} more" if len(told) > MOST_NAMED else ""
    return Assumption(
        f"each removed object is one vehicle of at most {LONGEST_M:g} m",
        not told,
        ", ".join(told[:MOST_NAMED]) + more if told else "all are",
        "its own points go, but nothing else that lies in its box",
    )


def run(context: StageContext) -> Facts:
    """surfels/removal.npz, masks/removed, masks/unobserved, regions. Returns what was assumed of the objects."""
    workspace, settings = context.workspace, context.settings
    drive = read_imported(workspace.drive_dir, points=False)
    scene, frames = load_selection(workspace), drive.frames
    surfels = read_surfels(workspace.surfels_full)
    instances = load_array(workspace.root / "surfels/instances.npy")
    ground, exposures = read_ground(workspace.ground_npz), read_exposures(workspace.exposure_json)
    selected = removed_surfels(surfels, instances, scene, drive, ground.street)
    gone = selected.removed
    by_hand = [m for m in marked_objects(settings.marked) if m.id in scene.instances]
    pixels = ObjectPixels(
        drive,
        scene,
        ground.street,
        drawn_by_kind(surfels, gone, instances, by_hand, settings.grown_px),
        by_hand,
        settings.grown_px,
        lambda frame: as_bytes(exposures.read(frame)),
        read_moving(workspace.root).pixels,
        ego_pixels,
    )
    stored = context.cache.stored(context.scratch("seen"), len(frames), lambda i: (pixels.seen(frames[i]).depth,))
    views = SeenViews([f.camera for f in frames], Frames(len(frames), lambda i: SeenView(*stored[i])))
    for done, _ in enumerate(each(stored.__getitem__, range(len(frames)))):
        context.progress(done + 1, 2 * len(frames), "finding what no frame shows")
    removed = Frames(len(frames), lambda i: grow(views.frames[i].hidden, border_px(frames[i].camera.width)))

    def find_remains() -> dict[str, NDArray[Any]]:
        so_far = context.kept.checkpoint("remains_so_far")
        return {"found": remains(surfels, gone, views.cameras, removed, so_far, context.progress)}

    if on("remains"):
        gone = gone | context.kept.once("remains", find_remains)["found"]
    short = shortened(surfels, ~gone, views) if on("shortened") else NOT_SHORTENED
    edit = SceneEdit.removing(gone, short)
    write_edit(edit, context.output("surfels/removal.npz"))
    empty = empty_street(edit.apply(surfels), ground, scene.labels.indices(GROUND_CLASSES))

    def write(i: int) -> None:
        last = frame_file(context.output("regions"), frames[i])
        if last.is_file():  # written by an attempt that was interrupted
            return
        camera, hidden, mask = frames[i].camera, views.frames[i].hidden, removed[i]
        unseen = never_seen(camera, hidden, empty.depth(camera, hidden), views)
        save_mask(mask, frame_file(context.output("masks/removed"), frames[i]))
        save_mask(unseen, frame_file(context.output("masks/unobserved"), frames[i]))
        write_image_atomic(last, region_map(mask, hidden, unseen))

    for done, _ in enumerate(each(write, range(len(frames)))):
        context.progress(len(frames) + done + 1, 2 * len(frames), "finding what no frame shows")
    names = {int(entry["id"]): str(entry["class"]) for entry in listed_objects(workspace) if "class" in entry}
    return assumed([_vehicles_assumed(selected.not_one, names)])
