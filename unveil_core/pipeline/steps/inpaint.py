"""Stage ``inpaint``: what the removed objects hid, filled in every frame and as new surfels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.base.onnx_files import files_of
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.chart.files import save_chart
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M
from unveil_core.inpaint.frames.holes import FrameTask
from unveil_core.inpaint.frames.keyframe_plan import plan_drive, plan_json
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit, new_ground, seed_ground
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene, propagate_inpainting
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.origin import CONTINUED, INVENTED
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.inpaint.street_scene import Removal, Views, complete_scene, drive_views, empty_ground_chart
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Facts, Stage, StageContext
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import Sky, load_sky
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import frame_file, load_array, load_mask, load_selection, save_array, save_mask
from unveil_core.workspace.movers import read_moving
from unveil_core.workspace.workspace import Workspace

__all__ = ["STAGE"]


def run(context: StageContext) -> Facts:
    """inpainted/ in canonical colours and inpaint/origins/, where its pixels come from; inpaint/keyframes.json, inpaint/chart.npz,
    masks/shadows; surfels/seeds.ply and surfels/seed_origins.npy; and of full.ply's surfels those that they replace and those that
    lost a shadow: surfels/displaced.npy, surfels/relit.npy. Returns where the sun was found, and what was assumed."""
    return inpaint_with(context)


def inpaint_with(context: StageContext, *, charts: bool = True) -> Facts:
    """The stage (see :func:`run`).

    Args:
        charts: False leaves out what is known of the street before anything is invented: then everything that nobody saw is
            invented in the images, as in the paper.
    """
    given = _read(context)
    drive, scene, surfels, gone = given.drive, given.scene, given.removal.surfels, given.removal.gone
    street = read_ground(context.workspace.ground_npz).street if charts else None
    chart, sun = None, None
    displaced, relit = np.zeros((2, len(surfels)), dtype=bool)
    if street is not None:
        chart, sun = empty_ground_chart(
            drive,
            scene,
            street,
            given.removal,
            given.views,
            shadows=context.settings.shadows != "off",
            sun=context.settings.sun,
            progress=context.progress,
        )
        cameras = [f.camera for f in drive.frames]
        anew = new_ground(chart, surfels.means.double().numpy()[gone], cameras, given.views.removed)
        displaced = ~gone & displaced_by(chart, anew, surfels, scene.labels.indices(GROUND_CLASSES))
        relit = ground_relit(chart, surfels)
    remaining = surfels.select(torch.from_numpy(~(gone | displaced)))
    parts: list[Surfels] = []
    layer, sky = None, None
    tested = [] if chart is None or context.settings.shadows == "off" else [_sun_assumed(sun)]
    if street is not None and chart is not None:
        completed = complete_scene(drive, scene, street, remaining, given.views, context.cache)
        feet, sky = completed.feet, completed.sky
        if scene.labels.index("building") is not None:
            tested.append(_facades_assumed(completed.sides, len(completed.facades)))
        parts = [*completed.facades, *([] if feet is None else [feet])]
        layer = GroundLayer(
            chart,
            feet=np.zeros((0, 3)) if feet is None else feet.means.double().numpy(),
            ground_labels=scene.labels.indices(GROUND_CLASSES),
        )
    # What follows from the seen part of a house or a pole is known before anything is invented.
    known = RemainingScene(concatenate([remaining, *parts]), given.sky, layer, len(scene.labels))
    seeds = _propagate(context, given, known, sky)
    invented = range(len(parts), len(parts) + (seeds is not None))
    parts += [] if seeds is None else [seeds]
    if chart is not None:
        spacing = REOPTIMIZE_PRESETS[context.settings.quality].ground_spacing_m
        label = scene.labels.index("road") or 0
        parts.append(seed_ground(chart, anew, spacing=spacing, sh_degree=remaining.sh_degree, default_label=label))
    origins = [np.full(len(p), INVENTED if k in invented else CONTINUED, np.uint8) for k, p in enumerate(parts)]
    save_array(np.concatenate([np.zeros(0, np.uint8), *origins]), context.output("surfels/seed_origins.npy"))
    seeds = concatenate(parts) if parts else remaining.select(torch.zeros(len(remaining), dtype=torch.bool))
    write_surfels(seeds, context.output("surfels/seeds.ply"), to_world=drive.to_world)
    save_array(displaced.astype(np.uint8), context.output("surfels/displaced.npy"))
    save_array(relit.astype(np.uint8), context.output("surfels/relit.npy"))
    save_chart(chart, context.output("inpaint/chart.npz"))
    if sun is None:
        return {"sun": None, **assumed(tested)}
    numbers = {"azimuth_deg": sun.azimuth, "elevation_deg": sun.elevation, "score": sun.score}
    return {"sun": {name: round(value, 3) for name, value in numbers.items()}, **assumed(tested)}


def _sun_assumed(sun: Sun | None) -> Assumption:
    found = "no direction from which shadows would lie where it is dark, and take light away"
    if sun is not None:
        found = f"azimuth {sun.azimuth:.0f}, elevation {sun.elevation:.0f} degrees"
    instead = f"what is dark within {SHADOW_REACH_M:g} m of a removed object counts as its shadow"
    return Assumption("the sun shines", sun is not None, found, instead)


def _facades_assumed(sides: int, completed: int) -> Assumption:
    found = f"on {sides} of 2 sides, completed on {completed}"
    return Assumption(
        "facades stand along the street", sides > 0, found, "what was not seen of them is filled frame by frame"
    )


@dataclass(frozen=True, eq=False)
class _Given:
    """What the stage reads: the drive, the chosen labels, what is removed, the frames, and what nobody saw of each.

    Attributes:
        shaded: (H, W) bool per frame, shadows of moving objects; unobserved: (H, W) bool per frame.
    """

    drive: Drive
    scene: SceneLabels
    removal: Removal
    sky: Sky
    views: Views
    shaded: Sequence[Mask]
    unobserved: Sequence[Mask]


def _read(context: StageContext) -> _Given:
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_selection(workspace)
    surfels = read_surfels(workspace.surfels_full)
    gone = load_array(workspace.root / "surfels/removed.npy").astype(bool)
    removal = Removal(surfels, gone, load_array(workspace.root / "surfels/instances.npy"))
    exposures = read_exposures(workspace.exposure_json)
    frames, cache = drive.frames, context.cache
    images = cache.frames(len(frames), lambda i: exposures.read(frames[i]))
    objects, unobserved = (
        cache.frames(len(frames), partial(_mask, frames, workspace.root / f"masks/{name}"))
        for name in ("removed", "unobserved")
    )
    shaded = read_moving(workspace.root).shadows(drive, objects, context.settings.shadows)
    removed = cache.frames(len(frames), lambda i: objects[i] | shaded[i])
    views = drive_views(drive, scene, surfels, images, removed, cache, context.scratch("depths"))
    return _Given(drive, scene, removal, load_sky(workspace.root / "surfels/sky.npz"), views, shaded, unobserved)


def _mask(frames: Sequence[Frame], folder: Path, i: int) -> Mask:
    return load_mask(frame_file(folder, frames[i]))


def _propagate(
    context: StageContext, given: _Given, known: RemainingScene, sky: Sequence[Mask] | None
) -> Surfels | None:
    """Choose the keyframes, record them, and clean and write all frames; returns the surfels of what was invented.

    Args:
        sky: (H, W) bool per frame, where the sky goes on behind removed objects; None where that is not known.
    """
    frames, views, settings = given.drive.frames, given.views, context.settings

    def task(i: int) -> FrameTask:
        kept = np.isin(views.labels[i], given.scene.removable_labels) & ~views.removed[i]
        over = None if sky is None else sky[i]
        return FrameTask(frames[i].camera, views.images[i], views.removed[i], given.unobserved[i], kept, over)

    def write(i: int, result: Painted) -> None:
        write_image_atomic(frame_file(context.output("inpainted"), frames[i]), result.image)
        write_image_atomic(frame_file(context.output("inpaint/origins"), frames[i]), result.origin)
        save_mask(result.shadow | given.shaded[i], frame_file(context.output("masks/shadows"), frames[i]))

    tasks = Frames(len(frames), task)
    order, names = settings.order, settings.keyframes
    plan = plan_drive(
        frames,
        tasks,
        known.surfels,
        known.ground,
        order=order,
        names=names,
        cache=context.cache,
        scratch=context.scratch("holes"),
        progress=context.progress,
    )
    record = plan_json(plan, frames, order=order, given=bool(names))
    write_json_atomic(context.output("inpaint/keyframes.json"), record)
    network = settings.networks.get("reference_inpainter")
    return propagate_inpainting(
        tasks,
        known,
        inpainter(settings.inpainter),
        write,
        plan=plan,
        reference=None if network is None else load_reference(network),
        progress=context.progress,
    )


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
        "inpaint/chart.npz",
        "inpaint/origins",
        "masks/shadows",
        "surfels/seeds.ply",
        "surfels/seed_origins.npy",
        "surfels/displaced.npy",
        "surfels/relit.npy",
    ),
    outside=files_of_networks,
    check=check_networks,
    settings=("quality", "shadows", "inpainter", "reference_inpainter", "order", "keyframes"),
)
