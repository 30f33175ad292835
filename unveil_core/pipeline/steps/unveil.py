"""The stages that take objects out and put the empty street in: remove, inpaint, reoptimize."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.files import read_image, write_image_atomic, write_json_atomic
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import MarkedObject, marked_objects, matte
from unveil_core.drives.scene_range import scene_range
from unveil_core.geometry.axes import up_frame
from unveil_core.geometry.images import grow
from unveil_core.inpaint.frames.compose import compose_frame
from unveil_core.inpaint.frames.holes import FrameTask
from unveil_core.inpaint.frames.keyframe_plan import plan_drive, plan_json
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit, new_ground, seed_ground
from unveil_core.inpaint.frames.propagate import paint_along
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.inpaint.street_scene import drive_continued, drive_ground, drive_ground_layer, drive_views
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS, reoptimize
from unveil_core.pipeline.runner import StageContext
from unveil_core.raster import render
from unveil_core.raster.picture import picture_of
from unveil_core.remove.behind import empty_street
from unveil_core.remove.observed import never_seen, seen_view
from unveil_core.remove.regions import region_map
from unveil_core.remove.selection import near_removed, select_removed
from unveil_core.remove.unsupported import unsupported
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_instances, frame_labels
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import load_sky
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.workspace.files import frame_file, load_array, load_labels, load_mask, save_array, save_mask
from unveil_core.workspace.movers import read_moving

LOOSE_M = 0.5
"""How far from an object its loose ends may lie, metres."""

# ---------------------------------------------------------------------------------------------------------------- remove


def object_mask(frame: Frame, scene: SceneLabels, rendered: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels in which this frame shows something that goes.

    From the frame's own labels or instances where it has them, else from the rendered share of the removed surfels: so
    masks on some frames are carried to the others through the scene.
    """
    label = frame_labels(frame, scene)
    known = label >= 0
    mask = np.isin(label, scene.removed_labels)
    instances = frame_instances(frame)
    if scene.instances and instances is not None:
        mask |= np.isin(instances, scene.instances)
    elif scene.instances:
        mask |= rendered > 0.5
    return mask | (~known & (rendered > 0.5))


def marked_pixels(
    marked: Sequence[MarkedObject], drive: Drive, frame: Frame, rendered: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """(H, W) pixels of marked objects: their mattes where this frame has them, else their ``rendered`` share (H, W)."""
    mattes = [None if m.mattes is None else matte(m.mattes, drive, frame) for m in marked]
    mask = np.zeros(rendered.shape, dtype=bool)
    for own in mattes:
        mask |= rendered > 0.5 if own is None else own
    return mask


def _loose_ends(drive: Drive, scene: SceneLabels, surfels: Surfels, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) surfels that go because no masked frame backs them: masks drawn by hand are missing in some frames and loose in others,
    and where there are no classes, a surfel's label is no more than what most frames say."""
    labels = [frame_labels(f, scene) for f in drive.frames]
    cameras = [f.camera for f, label in zip(drive.frames, labels, strict=True) if (label >= 0).any()]
    masks = [np.isin(label, scene.removed_labels) for label in labels if (label >= 0).any()]
    reach = LOOSE_M * scene_range(drive).unit
    return unsupported(surfels.means.double().numpy(), gone, cameras, masks, reach=reach)


def remove_body(context: StageContext) -> None:
    """surfels/removed.npy, masks/removed, masks/unobserved, regions."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    surfels = read_surfels(workspace.surfels_full)
    limits = scene_range(drive)
    of_surfel = load_array(workspace.root / "surfels/instances.npy")
    gone = select_removed(
        surfels, of_surfel, scene, too_close=0.08 * limits.unit, axes=up_frame(drive.up), unit=limits.unit
    )
    on_ground = scene.labels.indices(GROUND_CLASSES)
    if not on_ground:
        gone |= _loose_ends(drive, scene, surfels, gone)
    save_array(gone.astype(np.uint8), context.output("surfels/removed.npy"))
    keep = torch.from_numpy(~gone)
    left = surfels.select(keep)
    by_hand = [m for m in marked_objects(context.settings.marked) if m.id in scene.instances]
    # No label or instance image tells where these are: they are drawn apart.
    kinds = (~keep).long() + torch.from_numpy(gone & np.isin(of_surfel, [m.id for m in by_hand])).long()
    told = Surfels(surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh, kinds)
    ground = drive_ground(drive, scene, left)
    empty = empty_street(drive, surfels, gone, ground, on_ground)
    moving = read_moving(workspace.root)
    views = []
    for done, frame in enumerate(drive.frames):
        planes = ("alpha", "depth", "semantics")
        with torch.no_grad():
            full = render(told, frame.camera, planes, label_count=3, near=limits.near, far=limits.far)
        assert full.alpha is not None and full.depth is not None and full.semantics is not None
        share = full.semantics.numpy()
        own = object_mask(frame, scene, share[..., 1] + share[..., 2]) | moving.pixels(frame)
        own |= marked_pixels(by_hand, drive, frame, share[..., 2])
        label = frame_labels(frame, scene)
        by_label = (label >= 0, np.isin(label, on_ground)) if on_ground else None
        views.append(seen_view(frame.camera, full.depth.numpy(), full.alpha.numpy(), own, by_label))
        context.progress(done + 1, 2 * len(drive.frames), "finding what nobody saw")
    for done, (frame, view) in enumerate(zip(drive.frames, views, strict=True)):
        unseen = never_seen(frame.camera, view.hidden, empty.depth(frame.camera, view.hidden), views)
        # Antialiased borders carry the object's colour one or two pixels beyond its label.
        removed = grow(view.hidden, max(2, round(frame.camera.width / 400)))
        save_mask(removed, frame_file(context.output("masks/removed"), frame))
        save_mask(unseen, frame_file(context.output("masks/unobserved"), frame))
        write_image_atomic(frame_file(context.output("regions"), frame), region_map(removed, view.hidden, unseen))
        context.progress(len(drive.frames) + done + 1, 2 * len(drive.frames), "finding what nobody saw")


# --------------------------------------------------------------------------------------------------------------- inpaint


def inpaint_body(context: StageContext) -> None:
    """inpainted/ in canonical colours, inpaint/keyframes.json, masks/shadows; surfels/seeds.ply, and of full.ply's surfels
    those that they take the place of and those whose shadow went: surfels/displaced.npy, surfels/relit.npy."""
    inpaint_with(context)


def inpaint_with(context: StageContext, *, charts: bool = True) -> None:
    """The stage (see :func:`inpaint_body`).

    Args:
        charts: False leaves out what is known of the street before anything is invented: then everything that nobody saw is
            invented in the pictures, as in the paper.
    """
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    surfels = read_surfels(workspace.surfels_full)
    sky = load_sky(workspace.root / "surfels/sky.npz")
    gone = load_array(workspace.root / "surfels/removed.npy").astype(bool)
    limits = scene_range(drive)
    exposures = read_exposures(workspace.exposure_json)
    images = [exposures.read(f) for f in drive.frames]
    removed = [load_mask(frame_file(workspace.root / "masks/removed", f)) for f in drive.frames]
    unobserved = [load_mask(frame_file(workspace.root / "masks/unobserved", f)) for f in drive.frames]
    shaded = read_moving(workspace.root).shadows(drive, removed, context.settings.shadows)
    removed = [mask | shadow for mask, shadow in zip(removed, shaded, strict=True)]
    views = drive_views(drive, scene, surfels, images, removed)
    layer = drive_ground_layer(context, drive, scene, surfels, gone, views) if charts else None
    cameras = [f.camera for f in drive.frames]
    displaced, relit = np.zeros((2, len(surfels)), dtype=bool)
    if layer is not None:
        places = surfels.means.double().numpy()[gone]
        anew = new_ground(layer.chart, places, cameras, removed, unit=limits.unit)
        displaced = ~gone & displaced_by(layer.chart, anew, surfels, scene.labels.indices(GROUND_CLASSES))
        relit = ground_relit(layer.chart, surfels, unit=limits.unit)
    left = surfels.select(torch.from_numpy(~(gone | displaced)))
    goes_on: list[Surfels] = []
    if layer is not None:
        goes_on, layer = drive_continued(drive, scene, left, layer, views)
    # What the rest of a house or a trunk tells of what is hidden of it is known before anything is invented.
    known = concatenate([left, *goes_on])
    stands = [
        np.isin(labels, scene.removable_labels) & ~mask for labels, mask in zip(views.labels, removed, strict=True)
    ]
    tasks = [FrameTask(f.camera, images[i], removed[i], unobserved[i], stands[i]) for i, f in enumerate(drive.frames)]
    network = context.settings.networks.get("reference_inpainter")
    order, names = context.settings.order, context.settings.keyframes
    plan = plan_drive(
        drive.frames, tasks, known, layer, order=order, names=names, near=limits.near, far=limits.far,
        progress=context.progress,
    )  # fmt: skip
    told = plan_json(plan, drive.frames, order=order, given=bool(names), unit=limits.unit)
    write_json_atomic(context.output("inpaint/keyframes.json"), told)
    painted, seeds = paint_along(
        tasks, known, sky, layer, inpainter(context.settings.inpainter), label_count=len(scene.labels),
        near=limits.near, far=limits.far, plan=plan,
        reference=None if network is None else load_reference(network), progress=context.progress,
    )  # fmt: skip
    for frame, result, shadow in zip(drive.frames, painted, shaded, strict=True):
        write_image_atomic(frame_file(context.output("inpainted"), frame), result.image)
        save_mask(result.shadow | shadow, frame_file(context.output("masks/shadows"), frame))
    parts = [*goes_on, *([] if seeds is None else [seeds])]
    if layer is not None:
        preset = REOPTIMIZE_PRESETS[context.settings.quality]
        default = scene.labels.index("road")
        parts.append(
            seed_ground(
                layer.chart, anew, spacing=preset.ground_spacing_m * limits.unit, up=drive.up,
                sh_degree=left.sh_degree, default_label=0 if default is None else default,
            )
        )  # fmt: skip
    seeds = concatenate(parts) if parts else left.select(torch.zeros(len(left), dtype=torch.bool))
    write_surfels(seeds, context.output("surfels/seeds.ply"), offset=drive.offset)
    save_array(displaced.astype(np.uint8), context.output("surfels/displaced.npy"))
    save_array(relit.astype(np.uint8), context.output("surfels/relit.npy"))


# ------------------------------------------------------------------------------------------------------------ reoptimize


def reoptimize_body(context: StageContext) -> None:
    """surfels/empty.ply; renders/ and frames/, each in its own photograph's exposure."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    full = read_surfels(workspace.surfels_full)
    sky = load_sky(workspace.root / "surfels/sky.npz")
    gone = load_array(workspace.root / "surfels/removed.npy").astype(bool)
    displaced = load_array(workspace.root / "surfels/displaced.npy").astype(bool)
    relit = load_array(workspace.root / "surfels/relit.npy").astype(bool)
    seeds = read_surfels(workspace.root / "surfels/seeds.ply")
    limits = scene_range(drive)
    preset = REOPTIMIZE_PRESETS[context.settings.quality]
    stays = ~(gone | displaced)
    near = near_removed(full, gone, preset.near_m * limits.unit)
    surfels = concatenate([full.select(torch.from_numpy(stays)), seeds])
    movable = np.concatenate([(near | relit)[stays], np.ones(len(seeds), dtype=bool)])
    exposures = read_exposures(workspace.exposure_json)
    clean = [read_image(frame_file(workspace.root / "inpainted", f)) for f in drive.frames]
    empty = reoptimize(
        surfels, movable, sky, [(f.camera, clean[i]) for i, f in enumerate(drive.frames)], preset,
        unit=limits.unit, near=limits.near, far=limits.far, label_count=len(scene.labels),
        seed=context.settings.seed, progress=context.progress,
    )  # fmt: skip
    write_surfels(empty, context.output("surfels/empty.ply"), offset=drive.offset)
    moving = read_moving(workspace.root)
    for i, frame in enumerate(drive.frames):
        picture = picture_of(empty, sky, frame.camera, near=limits.near, far=limits.far)
        write_image_atomic(frame_file(context.output("renders"), frame), exposures.delivered(frame, picture))
        removed = load_mask(frame_file(workspace.root / "masks/removed", frame))
        shadows = load_mask(frame_file(workspace.root / "masks/shadows", frame))
        photograph = read_image(frame.image_path)
        # Behind the objects the scene as all frames have taught it; its shadows were taken from the photograph itself.
        # Around movers nothing was taught anew: what others saw there comes as the photographs show it.
        taught = removed & ~grow(moving.pixels(frame), 2)
        street = exposures.delivered(frame, np.where(taught[..., None], picture, clean[i]))
        delivered = compose_frame(photograph, street, removed | shadows)
        write_image_atomic(frame_file(context.output("frames"), frame), delivered)
