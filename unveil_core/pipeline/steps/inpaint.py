"""Stage ``inpaint``: what the removed objects hid, filled in every frame and as new surfels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.onnx_files import files_of
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.frames.holes import FrameTask
from unveil_core.inpaint.frames.keyframe_plan import plan_drive, plan_json
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit, new_ground, seed_ground
from unveil_core.inpaint.frames.propagate import RemainingScene, propagate_inpainting
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.inpaint.street_scene import drive_continued, drive_ground_layer, drive_views
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import load_sky
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.workspace.files import frame_file, load_array, load_mask, load_selection, save_array, save_mask
from unveil_core.workspace.movers import read_moving
from unveil_core.workspace.workspace import Workspace

__all__ = ["STAGE"]


def run(context: StageContext) -> None:
    """inpainted/ in canonical colours, inpaint/keyframes.json, masks/shadows; surfels/seeds.ply, and of full.ply's surfels
    those that they take the place of and those whose shadow went: surfels/displaced.npy, surfels/relit.npy."""
    inpaint_with(context)


def inpaint_with(context: StageContext, *, charts: bool = True) -> None:
    """The stage (see :func:`run`).

    Args:
        charts: False leaves out what is known of the street before anything is invented: then everything that nobody saw is
            invented in the pictures, as in the paper.
    """
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_selection(workspace)
    surfels = read_surfels(workspace.surfels_full)
    sky = load_sky(workspace.root / "surfels/sky.npz")
    gone = load_array(workspace.root / "surfels/removed.npy").astype(bool)
    exposures = read_exposures(workspace.exposure_json)
    images = [exposures.read(f) for f in drive.frames]
    removed = [load_mask(frame_file(workspace.root / "masks/removed", f)) for f in drive.frames]
    unobserved = [load_mask(frame_file(workspace.root / "masks/unobserved", f)) for f in drive.frames]
    shaded = read_moving(workspace.root).shadows(drive, removed, context.settings.shadows)
    removed = [mask | shadow for mask, shadow in zip(removed, shaded, strict=True)]
    views = drive_views(drive, scene, surfels, images, removed)
    street = read_ground(workspace.ground_npz).street
    layer = (
        drive_ground_layer(
            drive, scene, street, surfels, gone, load_array(workspace.root / "surfels/instances.npy"), views,
            shadows=context.settings.shadows != "off", sun=context.settings.sun, progress=context.progress,
        )
        if charts and street is not None
        else None
    )  # fmt: skip
    cameras = [f.camera for f in drive.frames]
    displaced, relit = np.zeros((2, len(surfels)), dtype=bool)
    if layer is not None:
        places = surfels.means.double().numpy()[gone]
        anew = new_ground(layer.chart, places, cameras, removed)
        displaced = ~gone & displaced_by(layer.chart, anew, surfels, scene.labels.indices(GROUND_CLASSES))
        relit = ground_relit(layer.chart, surfels)
    left = surfels.select(torch.from_numpy(~(gone | displaced)))
    goes_on: list[Surfels] = []
    if layer is not None:
        goes_on, layer = drive_continued(drive, scene, left, layer, views)
    # What the rest of a house or a trunk tells of what is hidden of it is known before anything is invented.
    known = concatenate([left, *goes_on])
    kept = [np.isin(labels, scene.removable_labels) & ~mask for labels, mask in zip(views.labels, removed, strict=True)]
    tasks = [FrameTask(f.camera, images[i], removed[i], unobserved[i], kept[i]) for i, f in enumerate(drive.frames)]
    network = context.settings.networks.get("reference_inpainter")
    order, names = context.settings.order, context.settings.keyframes
    plan = plan_drive(drive.frames, tasks, known, layer, order=order, names=names, progress=context.progress)
    record = plan_json(plan, drive.frames, order=order, given=bool(names))
    write_json_atomic(context.output("inpaint/keyframes.json"), record)
    painted, seeds = propagate_inpainting(
        tasks,
        RemainingScene(known, sky, layer, len(scene.labels)),
        inpainter(context.settings.inpainter),
        plan=plan,
        reference=None if network is None else load_reference(network),
        progress=context.progress,
    )
    for frame, result, shadow in zip(drive.frames, painted, shaded, strict=True):
        write_image_atomic(frame_file(context.output("inpainted"), frame), result.image)
        save_mask(result.shadow | shadow, frame_file(context.output("masks/shadows"), frame))
    parts = [*goes_on, *([] if seeds is None else [seeds])]
    if layer is not None:
        preset = REOPTIMIZE_PRESETS[context.settings.quality]
        default = scene.labels.index("road")
        parts.append(
            seed_ground(
                layer.chart, anew, spacing=preset.ground_spacing_m, up=drive.up,
                sh_degree=left.sh_degree, default_label=0 if default is None else default,
            )
        )  # fmt: skip
    seeds = concatenate(parts) if parts else left.select(torch.zeros(len(left), dtype=torch.bool))
    write_surfels(seeds, context.output("surfels/seeds.ply"), to_world=drive.to_world)
    save_array(displaced.astype(np.uint8), context.output("surfels/displaced.npy"))
    save_array(relit.astype(np.uint8), context.output("surfels/relit.npy"))


def files_of_networks(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """The networks that the settings name, with the weights that lie beside them."""
    found = []
    for name, path in settings.networks.items():
        found += [(name + file.name.removeprefix(path.name), file) for file in files_of(path)]
    return found


def check_networks(settings: RunSettings) -> None:
    """Raise a SettingsError unless the named networks are there and are such networks."""
    inpainter(settings.inpainter)
    if "reference_inpainter" in settings.networks:
        load_reference(settings.networks["reference_inpainter"])


STAGE = Stage(
    "inpaint",
    run,
    inputs=(
        "drive",
        "labels.json",
        "selection.json",
        "movers",
        "surfels/full.ply",
        "surfels/sky.npz",
        "surfels/exposure.json",
        "surfels/removed.npy",
        "surfels/instances.npy",
        "ground",
        "masks/removed",
        "masks/unobserved",
    ),
    outputs=(
        "inpainted",
        "inpaint/keyframes.json",
        "masks/shadows",
        "surfels/seeds.ply",
        "surfels/displaced.npy",
        "surfels/relit.npy",
    ),
    outside=files_of_networks,
    check=check_networks,
    settings=("quality", "shadows", "inpainter", "reference_inpainter", "order", "keyframes"),
)
