"""The stages that name single objects: from the points, before there is a scene; and among its surfels."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.files import read_image, read_json, write_image_atomic, write_json_atomic
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import marked_objects, matte
from unveil_core.drives.scene_range import scene_range
from unveil_core.geometry.axes import up_frame
from unveil_core.ground.sparse import GROUND_NAMES
from unveil_core.pipeline.runner import StageContext
from unveil_core.semantics.catalogue import best_sighting, thumbnail
from unveil_core.semantics.instances import fit_box, vote_instances
from unveil_core.semantics.labels import SceneLabels, find_labels, frame_instances
from unveil_core.semantics.objects import (
    ABOVE_GROUND_M,
    CLUSTER_M,
    FoundObjects,
    SceneObject,
    find_objects,
    marked_box,
    vote_mattes,
)
from unveil_core.semantics.visibility import points_in_view
from unveil_core.surfels.ply import read_surfels
from unveil_core.workspace.files import load_array, load_labels, save_array
from unveil_core.workspace.movers import read_moving
from unveil_core.workspace.workspace import Workspace

__all__ = ["instances_body", "known_objects", "objects_body"]


def known_objects(workspace: Workspace) -> tuple[int, ...] | None:
    """Ids of the objects that a workspace lists, None where it does not list any yet."""
    if not workspace.objects_json.is_file():
        return None
    listed: Any = read_json(workspace.objects_json)
    return tuple(int(o["id"]) for o in listed["objects"])


# --------------------------------------------------------------------------------------------------- before there is a scene


def objects_body(context: StageContext) -> None:
    """objects.json and objects/: what could be chosen, with pictures, and what each of the drive's points is."""
    drive = read_imported(context.workspace.drive_dir)
    scene = find_labels(drive)
    found = find_objects(drive, scene, marked_objects(context.settings.marked), context.progress)
    unit = scene_range(drive).unit
    entries = []
    for done, thing in enumerate(found.objects):
        entries.append(_entry(context, drive, thing, unit))
        context.progress(done + 1, len(found.objects), "naming objects")
    disk_ids = np.array([*scene.labels.disk_ids, 255], np.uint8)
    save_array(disk_ids[found.point_labels], context.output("objects/point_labels.npy"))
    save_array(found.point_objects.astype(np.uint16), context.output("objects/point_objects.npy"))
    write_json_atomic(context.output("objects.json"), {
        "units_per_metre": unit, "axes": up_frame(drive.up).tolist(), "source": scene.source,
        "classes": _classes(scene, found), "objects": entries,
    })  # fmt: skip


def _entry(context: StageContext, drive: Drive, thing: SceneObject, unit: float) -> dict[str, object]:
    """What the lists tell of an object; ``distance_m`` from the nearest camera that sees it."""
    frames = [drive.frames[s.frame] for s in thing.sightings]
    picture = distance = shown = None
    if thing.sightings:
        best = best_sighting(drive, thing.sightings)
        shown = drive.frames[best.frame]
        picture = f"objects/{thing.id:04d}.png"
        image = read_image(shown.image_path)
        write_image_atomic(context.output(picture), thumbnail(image, best.rectangle))
    if thing.box is not None:
        centres = np.stack([f.camera.centre for f in frames or drive.frames])
        distance = round(float(np.linalg.norm(centres - thing.box.centre, axis=1).min()) / unit, 2)
    return {
        "id": thing.id, "class": thing.class_name, "source": thing.source,
        "box": None if thing.box is None else thing.box.to_json(), "points": thing.points, "frames": len(frames),
        "first_frame": frames[0].name if frames else None, "last_frame": frames[-1].name if frames else None,
        "best_camera": None if shown is None else shown.camera_name, "best_frame": None if shown is None else shown.name,
        "distance_m": distance, "thumbnail": picture,
    }  # fmt: skip


def _classes(scene: SceneLabels, found: FoundObjects) -> list[dict[str, object]]:
    points = np.bincount(found.point_labels[found.point_labels >= 0], minlength=len(scene.labels))
    names = [o.class_name for o in found.objects]
    return [
        {
            "name": name, "disk_id": scene.labels.disk_ids[k], "pixels": scene.pixel_counts[k], "points": int(points[k]),
            "objects": names.count(name), "removable": k in scene.removable_labels,
        }
        for k, name in enumerate(scene.labels.names)
    ]  # fmt: skip


# -------------------------------------------------------------------------------------------------------- among its surfels


def instances_body(context: StageContext) -> None:
    """instances.json and surfels/instances.npy: the listed objects among the scene's surfels."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    surfels = read_surfels(workspace.surfels_full)
    limits = scene_range(drive)
    labels = surfels.labels.numpy()
    positions = surfels.means.double().numpy()
    spacing = surfels.log_scales.exp().amax(dim=1).double().numpy() * 1.5
    removable = np.isin(labels, scene.removable_labels)
    of_surfel = np.zeros(len(surfels), dtype=np.int64)
    moving = read_moving(workspace.root)
    images = [moving.ids_of_standing(f, frame_instances(f)) for f in drive.frames]
    if any(image is not None for image in images):
        of_surfel[removable] = vote_instances(
            positions[removable], spacing[removable], [f.camera for f in drive.frames], lambda v: images[v],
            near=limits.near,
        )  # fmt: skip
    else:
        of_points = load_array(workspace.root / "objects/point_objects.npy").astype(np.int64)
        of_surfel[removable] = _of_nearest_point(positions[removable], drive, of_points, CLUSTER_M * limits.unit)
    _give_to_marked(of_surfel, context, drive, scene, positions, spacing, labels)

    axes = up_frame(drive.up)
    listed: Any = read_json(workspace.objects_json)
    entries: list[dict[str, object]] = []
    for done, known in enumerate(listed["objects"]):
        number, own = int(known["id"]), of_surfel == int(known["id"])
        context.progress(done + 1, len(listed["objects"]), "naming objects")
        if not own.any():
            continue
        box = known["box"] if known["source"] == "box" else fit_box(positions[own], axes, gap=limits.unit).to_json()
        picture = known["thumbnail"]
        if picture is not None:
            picture = f"instances/{number:04d}.png"
            shutil.copyfile(workspace.root / known["thumbnail"], context.output(picture))
        entries.append({
            **known, "box": box, "surfels": int(own.sum()), "thumbnail": picture,
            "removed": known["class"] in scene.removed or number in scene.instances,
        })  # fmt: skip
    context.output("instances").mkdir(parents=True, exist_ok=True)
    save_array(of_surfel, context.output("surfels/instances.npy"))
    write_json_atomic(context.output("instances.json"), entries)


def _of_nearest_point(
    positions: NDArray[np.float64], drive: Drive, of_points: NDArray[np.int64], reach: float
) -> NDArray[np.int64]:
    """The object (N,) of the nearest of the drive's points that has one, 0 where none is near."""
    named = of_points > 0
    if not named.any() or not len(positions):
        return np.zeros(len(positions), dtype=np.int64)
    distance, nearest = cKDTree(drive.points.positions[named]).query(positions, distance_upper_bound=reach)
    near = np.isfinite(distance)
    return np.where(near, of_points[named][np.where(near, nearest, 0)], 0)


def _give_to_marked(
    of_surfel: NDArray[np.int64], context: StageContext, drive: Drive, scene: SceneLabels,
    positions: NDArray[np.float64], spacing: NDArray[np.float64], labels: NDArray[np.int64],
) -> None:  # fmt: skip
    """Surfels of marked objects, whatever their label, but not the ground they stand on."""
    axes, limits = up_frame(drive.up), scene_range(drive)
    ground = scene.labels.indices(GROUND_NAMES)
    above = ~np.isin(labels, ground)
    views = None
    for mark in marked_objects(context.settings.marked):
        if mark.box is not None:
            box = marked_box(mark.box, drive)
            of_surfel[above & box.contains(positions, axes, margin=0.0, above=ABOVE_GROUND_M * limits.unit)] = mark.id
        elif mark.mattes is not None:
            views = views or [points_in_view(positions, spacing, f.camera, near=limits.near) for f in drive.frames]
            mattes = [matte(mark.mattes, drive, f) for f in drive.frames]
            of_surfel[above & vote_mattes(len(positions), views, mattes)] = mark.id
