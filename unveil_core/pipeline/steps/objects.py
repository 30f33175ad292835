"""Stage ``objects``: the classes and single objects that can be removed, from the drive's points and images."""

from __future__ import annotations

import numpy as np

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.drive import Drive, instants
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import marked_objects
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.pipeline.stage import StageContext
from unveil_core.semantics.catalogue import best_sighting, thumbnail
from unveil_core.semantics.labels import SceneLabels, find_labels
from unveil_core.semantics.objects import (
    FoundObjects,
    SceneObject,
    find_objects,
)
from unveil_core.workspace.files import save_array

__all__ = ["run"]


def run(context: StageContext) -> None:
    """objects.json and objects/: what can be chosen, with pictures, and class and object of each of the drive's points."""
    drive = read_imported(context.workspace.drive_dir)
    scene = find_labels(drive)
    found = find_objects(drive, scene, marked_objects(context.settings.marked), context.progress, context.cache)
    entries = []
    for done, thing in enumerate(found.objects):
        entries.append(_entry(context, drive, thing))
        context.progress(done + 1, len(found.objects), "naming objects")
    disk_ids = np.array([*scene.labels.disk_ids, 255], np.uint8)
    save_array(disk_ids[found.point_labels], context.output("objects/point_labels.npy"))
    save_array(found.point_objects.astype(np.uint16), context.output("objects/point_objects.npy"))
    write_json_atomic(
        context.output("objects.json"),
        {"axes": up_frame(UP).tolist(), "source": scene.source, "classes": _classes(scene, found), "objects": entries},
    )


def _entry(context: StageContext, drive: Drive, thing: SceneObject) -> dict[str, object]:
    """An object's entry in the list; ``distance_m``: from the nearest camera that sees it."""
    frames = [drive.frames[s.frame] for s in thing.sightings]
    frames = [frames[k] for k in np.argsort(instants(frames), kind="stable")]
    picture = distance = shown = None
    if thing.sightings:
        best = best_sighting(drive, thing.sightings)
        shown = drive.frames[best.frame]
        picture = f"objects/{thing.id:04d}.png"
        image = read_image(shown.image_path)
        write_image_atomic(context.output(picture), thumbnail(image, best.rectangle))
    if thing.box is not None:
        centres = np.stack([f.camera.centre for f in frames or drive.frames])
        distance = round(float(np.linalg.norm(centres - thing.box.centre, axis=1).min()), 2)
    return {
        "id": thing.id,
        "class": thing.class_name,
        "source": thing.source,
        "box": None if thing.box is None else thing.box.to_json(),
        "points": thing.points,
        "frames": len(frames),
        "first_frame": frames[0].name if frames else None,
        "last_frame": frames[-1].name if frames else None,
        "best_camera": None if shown is None else shown.camera_name,
        "best_frame": None if shown is None else shown.name,
        "distance_m": distance,
        "thumbnail": picture,
    }


def _classes(scene: SceneLabels, found: FoundObjects) -> list[dict[str, object]]:
    points = np.bincount(found.point_labels[found.point_labels >= 0], minlength=len(scene.labels))
    names = [o.class_name for o in found.objects]
    return [
        {
            "name": name,
            "disk_id": scene.labels.disk_ids[k],
            "pixels": scene.pixel_counts[k],
            "points": int(points[k]),
            "objects": names.count(name),
            "removable": k in scene.removable_labels,
        }
        for k, name in enumerate(scene.labels.names)
    ]
