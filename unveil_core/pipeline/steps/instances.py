"""Stage ``instances``: the listed objects among the scene's surfels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import copy_picture, write_json_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import MarkedObject, marked_objects, matte
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.pipeline.stage import StageContext
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.instances import fit_box, nearest_ids, vote_instances, without_strays
from unveil_core.semantics.labels import SceneLabels, frame_instances
from unveil_core.semantics.members import Members
from unveil_core.semantics.objects import ABOVE_GROUND_M, CLUSTER_M, marked_box, vote_mattes
from unveil_core.semantics.visibility import PointsInView, PointsNear
from unveil_core.surfels.ply import read_surfels
from unveil_core.workspace.files import listed_objects, load_array, load_selection, save_array
from unveil_core.workspace.movers import read_moving

__all__ = ["run"]


def run(context: StageContext) -> None:
    """instances.json and surfels/instances.npy: the listed objects among the scene's surfels."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_selection(workspace)
    surfels = read_surfels(workspace.surfels_full)
    labels = surfels.labels.numpy()
    positions = surfels.means.double().numpy()
    spacing = surfels.log_scales.exp().amax(dim=1).double().numpy() * 1.5
    removable = np.isin(labels, scene.removable_labels)
    of_surfel = np.zeros(len(surfels), dtype=np.int64)
    moving = read_moving(workspace.root)
    frames = drive.frames
    if any(f.instance_path is not None for f in frames):
        of_surfel[removable] = vote_instances(
            positions[removable],
            spacing[removable],
            labels[removable],
            [f.camera for f in frames],
            lambda v: moving.ids_of_static(frames[v], frame_instances(frames[v])),
            near=NEAR_M,
        )
    else:
        of_points = load_array(workspace.root / "objects/point_objects.npy").astype(np.int64)
        of_surfel[removable] = nearest_ids(drive.points.positions, of_points, positions[removable], reach=CLUSTER_M)
    _give_to_marked(of_surfel, context, drive, scene, positions, spacing, labels)

    axes = up_frame(UP)
    listed = listed_objects(workspace)
    entries: list[dict[str, object]] = []
    members = Members(of_surfel)
    for done, known in enumerate(listed):
        number, own = int(known["id"]), members[int(known["id"])]
        context.progress(done + 1, len(listed), "naming objects")
        if not len(own):
            continue
        box = (
            known["box"]
            if known["source"] in ("box", "boxes")
            else fit_box(without_strays(positions[own]), axes, gap=1.0).to_json()
        )
        made, picture = workspace.root / str(known["thumbnail"]), None
        if known["thumbnail"] is not None and made.is_file():
            picture = f"instances/{number:04d}.png"
            copy_picture(made, context.output(picture))
        entries.append(
            {
                **known,
                "box": box,
                "surfels": len(own),
                "thumbnail": picture,
                "removed": known["class"] in scene.removed or number in scene.instances,
            }
        )
    context.output("instances").mkdir(parents=True, exist_ok=True)
    save_array(of_surfel, context.output("surfels/instances.npy"))
    write_json_atomic(context.output("instances.json"), entries)


def _give_to_marked(
    of_surfel: NDArray[np.int64],
    context: StageContext,
    drive: Drive,
    scene: SceneLabels,
    positions: NDArray[np.float64],
    spacing: NDArray[np.float64],
    labels: NDArray[np.int64],
) -> None:
    """Surfels of marked objects, whatever their label, but not the ground they stand on."""
    axes = up_frame(UP)
    ground = scene.labels.indices(GROUND_CLASSES)
    above = ~np.isin(labels, ground)
    frames, marks = drive.frames, marked_objects(context.settings.marked)
    if not marks:
        return
    placed = PointsNear(positions, spacing)
    views: Sequence[PointsInView] = context.cache.frames(
        len(frames), lambda v: placed.seen_by(frames[v].camera, near=NEAR_M)
    )
    for mark in marks:
        if mark.box is not None:
            box = marked_box(mark.box, drive)
            of_surfel[above & box.contains(positions, axes, margin=0.0, above=ABOVE_GROUND_M)] = mark.id
        elif mark.mattes is not None:
            of_surfel[above & vote_mattes(len(positions), views, _mattes(mark, drive))] = mark.id


def _mattes(mark: MarkedObject, drive: Drive) -> Sequence[NDArray[np.bool_] | None]:
    return Frames(len(drive.frames), lambda v: matte(mark, drive, drive.frames[v]))
