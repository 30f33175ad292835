"""What each stage reads, computes and writes. The computing lives in the modules below; the order in ``stages``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.exposure import read_exposures, write_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing import import_drive
from unveil_core.evaluate import run_evaluation, write_metrics
from unveil_core.files import read_image, write_image_atomic, write_json_atomic
from unveil_core.inpaint.compose import compose_frame
from unveil_core.inpaint.exemplar import FillSettings
from unveil_core.inpaint.ground_layer import GroundLayer, build_ground_layer, fit_drive_ground, ground_usable
from unveil_core.inpaint.onnx_models import load_reference
from unveil_core.inpaint.single_image import inpainter
from unveil_core.inpaint.street import Ground
from unveil_core.inpaint.time_reversal import FrameTask, paint_along
from unveil_core.inpaint.transfer import render_numpy, seed_ground
from unveil_core.mesh import fuse, write_glb, write_ply
from unveil_core.mesh.views import depth_views
from unveil_core.optimize.adapt import CHOICES
from unveil_core.optimize.exposure import fit_exposures
from unveil_core.optimize.reconstruct import PRESETS, ReconstructSettings, reconstruct
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS, reoptimize
from unveil_core.optimize.scene_range import scene_range
from unveil_core.optimize.start import tracks
from unveil_core.raster import render
from unveil_core.remove.observed import never_seen, seen_view
from unveil_core.remove.regions import grow, region_map
from unveil_core.remove.selection import near_removed, select_removed
from unveil_core.report import write_report
from unveil_core.semantics.catalogue import frames_that_see, thumbnail
from unveil_core.semantics.instances import cluster_points, fit_box, vote_instances
from unveil_core.semantics.segment import SceneLabels, choose_labels, frame_instances, frame_labels
from unveil_core.settings import RunSettings
from unveil_core.stages import Stage, StageContext
from unveil_core.surfels.picture import picture_of
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import load_sky, save_sky, up_frame
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.workspace_files import frame_file, load_array, load_labels, load_mask, save_array, save_mask

MESH_VOXEL_M = {"draft": 0.12, "standard": 0.08, "high": 0.05}
"""Edge of a voxel of the fused meshes, metres."""
SOLID_CLASSES = ("building", "wall")
"""What reaches down to the ground and lets no light through, though cars may hide its foot."""
MAX_SIDE = {"draft": 512, "standard": 768, "high": 1600}
"""Longer image side that larger images are reduced to, pixels."""


# ---------------------------------------------------------------------------------------------------------------- import


def import_body(context: StageContext) -> None:
    """drive/: undistorted, recentred."""
    side = context.settings.max_side or MAX_SIDE[context.settings.quality]
    import_drive(open_drive(context.drive), context.output("drive"), max_side=side, progress=context.progress)


def segment_body(context: StageContext) -> None:
    """labels.json: which labels occur and which of them go."""
    drive = read_imported(context.workspace.drive_dir)
    settings = context.settings
    write_json_atomic(
        context.output("labels.json"), choose_labels(drive, settings.remove, settings.instances).to_json()
    )


# ----------------------------------------------------------------------------------------------------------- reconstruct


def asked_for(settings: RunSettings) -> ReconstructSettings:
    """The quality's limits, and what the user has decided instead.

    Colour by direction only if asked for: it explains the photographs better, but from where a removed object hid a wall nobody
    saw the wall's colour, and what it is guessed to be there shows the object's ghost.
    """
    preset = PRESETS[settings.quality]
    given = {
        "iterations": settings.iterations, "sh_degree": settings.sh_degree or 0, "budget": settings.splats,
    }  # fmt: skip
    decided: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return replace(preset, **decided, given=frozenset(decided) if settings.adapt else frozenset(CHOICES))


def reconstruct_body(context: StageContext) -> None:
    """surfels/full.ply and surfels/sky.npz, in the canonical colours that surfels/exposure.json defines."""
    reconstruct_with(context, asked_for(context.settings))


def reconstruct_with(context: StageContext, settings: ReconstructSettings) -> None:
    """What :func:`reconstruct_body` does, with settings of one's own: for comparison."""
    drive = read_imported(context.workspace.drive_dir)
    scene = load_labels(context.workspace)
    exposures = fit_exposures(drive, progress=context.progress)
    write_exposures(exposures, context.output("surfels/exposure.json"))
    done = reconstruct(
        drive, scene, settings, exposures=exposures, seed=context.settings.seed, progress=context.progress
    )
    comments = (f"labels {','.join(n.replace(' ', '_') for n in scene.labels.names)}",)
    write_surfels(done.surfels, context.output("surfels/full.ply"), offset=drive.offset, comments=comments)
    save_sky(done.sky, context.output("surfels/sky.npz"))
    context.workspace.update_stage("reconstruct", choices=done.choices)


def instances_body(context: StageContext) -> None:
    """instances.json and surfels/instances.npy: single objects among what can be removed."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    surfels = read_surfels(workspace.surfels_full)
    limits = scene_range(drive)
    removable = np.isin(surfels.labels.numpy(), scene.removable_labels)
    positions = surfels.means.double().numpy()
    means = positions[removable]
    spacing = surfels.log_scales.exp().amax(dim=1).double().numpy()[removable] * 1.5
    images = [frame_instances(f) for f in drive.frames]
    if any(image is not None for image in images):
        ids = vote_instances(means, spacing, [f.camera for f in drive.frames], lambda v: images[v], near=limits.near)
    else:
        ids = cluster_points(means, 0.4 * limits.unit)
    of_surfel = np.zeros(len(surfels), dtype=np.int64)
    of_surfel[removable] = ids
    save_array(of_surfel, context.output("surfels/instances.npy"))

    axes = up_frame(drive.up)
    labels = surfels.labels.numpy()
    entries: list[dict[str, object]] = []
    chosen = [int(i) for i in np.unique(ids) if i]
    for done, instance in enumerate(chosen):
        mask = of_surfel == instance
        label = int(np.bincount(labels[mask]).argmax())
        box = fit_box(positions[mask], axes, gap=1.0 * limits.unit)
        seen = frames_that_see(drive, positions[mask], images, instance)
        picture = None
        if seen:
            best, rectangle = seen[0]
            picture = f"instances/{instance:04d}.png"
            write_image_atomic(context.output(picture), thumbnail(read_image(drive.frames[best].image_path), rectangle))
        order = sorted(v for v, _ in seen)
        entries.append({
            "id": instance, "class": scene.labels.names[label], "box": box.to_json(), "surfels": int(mask.sum()),
            "first_frame": drive.frames[order[0]].name if order else None,
            "last_frame": drive.frames[order[-1]].name if order else None,
            "thumbnail": picture,
            "removed": label in scene.removed_labels or instance in scene.instances,
        })  # fmt: skip
        context.progress(done + 1, len(chosen), "naming objects")
    context.output("instances").mkdir(parents=True, exist_ok=True)
    write_json_atomic(context.output("instances.json"), entries)


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
    save_array(gone.astype(np.uint8), context.output("surfels/removed.npy"))
    keep = torch.from_numpy(~gone)
    left = surfels.select(keep)
    marked = Surfels(
        surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh, (~keep).long()
    )
    ground = drive_ground(drive, scene, left)
    views, empties = [], []
    for done, frame in enumerate(drive.frames):
        planes = ("alpha", "depth", "semantics")
        with torch.no_grad():
            full = render(marked, frame.camera, planes, label_count=2, near=limits.near, far=limits.far)
        assert full.alpha is not None and full.depth is not None and full.semantics is not None
        own = object_mask(frame, scene, full.semantics[..., 1].numpy())
        views.append(seen_view(frame.camera, full.depth.numpy(), full.alpha.numpy(), own))
        empties.append(render_numpy(left, frame.camera, near=limits.near, far=limits.far))
        context.progress(done + 1, 2 * len(drive.frames), "finding what nobody saw")
    for done, (frame, view, empty) in enumerate(zip(drive.frames, views, empties, strict=True)):
        ground_depth = np.full(view.hidden.shape, np.inf)
        if ground is not None:
            ground_depth[view.hidden] = ground.intersect(frame.camera, frame.camera.rays()[view.hidden])[0]
        unseen = never_seen(frame.camera, view.hidden, empty["alpha"], empty["depth"], ground_depth, views)
        # Antialiased borders carry the object's colour one or two pixels beyond its label.
        removed = grow(view.hidden, max(2, round(frame.camera.width / 400)))
        save_mask(removed, frame_file(context.output("masks/removed"), frame))
        save_mask(unseen, frame_file(context.output("masks/unobserved"), frame))
        write_image_atomic(frame_file(context.output("regions"), frame), region_map(removed, view.hidden, unseen))
        context.progress(len(drive.frames) + done + 1, 2 * len(drive.frames), "finding what nobody saw")


# --------------------------------------------------------------------------------------------------------------- inpaint


def drive_ground(drive: Drive, scene: SceneLabels, left: Surfels) -> Ground | None:
    """The ground under the drive's longest track, from the scene without what is removed; None where it has none."""
    track = max(tracks(drive), key=len)
    cameras = [drive.frames[i].camera for i in track]
    return fit_drive_ground(left, scene.labels, cameras, drive.up, unit=scene_range(drive).unit)


def drive_ground_layer(
    context: StageContext, drive: Drive, scene: SceneLabels, surfels: Surfels, gone: NDArray[np.bool_],
    images: Sequence[NDArray[np.uint8]], removed: Sequence[NDArray[np.bool_]],
) -> GroundLayer | None:  # fmt: skip
    """The ground of the empty street, or None where the scene has none."""
    limits = scene_range(drive)
    ground = drive_ground(drive, scene, surfels.select(torch.from_numpy(~gone)))
    if ground is None:
        return None
    labels = [frame_labels(f, scene) for f in drive.frames]
    usable = []
    for i, frame in enumerate(drive.frames):
        camera = frame.camera
        depth, _ = ground.intersect(camera, camera.rays().reshape(-1, 3))
        full = render_numpy(surfels, camera, near=limits.near, far=limits.far)
        usable.append(
            ground_usable(
                labels[i], scene.labels, grow(removed[i], 2), depth.reshape(camera.height, camera.width), full["depth"]
            )
        )
    means = surfels.means.double().numpy()
    of_surfel = np.where(gone, load_array(context.workspace.root / "surfels/instances.npy"), -1)
    removed_objects = [means[of_surfel == i] for i in np.unique(of_surfel) if i >= 0]
    fill = FillSettings(shadow_reach_m=5.0 if context.settings.shadows != "off" else 0.0)
    keep = torch.from_numpy(~gone)
    solid = [k for k, n in enumerate(scene.labels.names) if n in SOLID_CLASSES]
    return build_ground_layer(
        ground, [f.camera for f in drive.frames], images, labels, usable, removed_objects, fill,
        unit=limits.unit, scene=(surfels.select(keep), surfels.select(~keep)), solid=solid, sun=context.settings.sun,
        progress=context.progress,
    )  # fmt: skip


def inpaint_body(context: StageContext) -> None:
    """inpainted/ in canonical colours, masks/shadows, surfels/seeds.ply, surfels/relit.npy."""
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
    layer = drive_ground_layer(context, drive, scene, surfels, gone, images, removed)
    left = surfels.select(torch.from_numpy(~gone))
    tasks = [FrameTask(f.camera, images[i], removed[i], unobserved[i]) for i, f in enumerate(drive.frames)]
    network = context.settings.networks.get("reference_inpainter")
    painted, seeds = paint_along(
        tasks, left, sky, layer, inpainter(context.settings.inpainter), label_count=len(scene.labels),
        near=limits.near, far=limits.far, order=context.settings.order,
        reference=None if network is None else load_reference(network), progress=context.progress,
    )  # fmt: skip
    for frame, result in zip(drive.frames, painted, strict=True):
        write_image_atomic(frame_file(context.output("inpainted"), frame), result.image)
        save_mask(result.shadow, frame_file(context.output("masks/shadows"), frame))
    parts = [] if seeds is None else [seeds]
    relit = np.zeros(len(left), dtype=np.uint8)
    if layer is not None:
        preset = REOPTIMIZE_PRESETS[context.settings.quality]
        chart = layer.chart
        means = surfels.means.double().numpy()
        row, column, inside = chart.index_of(chart.ground.path.to_street(means[gone]))
        near = np.zeros(chart.source.shape, dtype=np.uint8)
        near[row[inside], column[inside]] = 1
        reach = max(3, int(1.5 * limits.unit / chart.texel) | 1)
        near = cv2.dilate(near, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach)))
        default = scene.labels.index("road")
        parts.append(
            seed_ground(
                chart, near.astype(bool), spacing=preset.ground_spacing_m * limits.unit, up=drive.up,
                sh_degree=left.sh_degree, default_label=0 if default is None else default,
            )
        )  # fmt: skip
        street = chart.ground.path.to_street(means[~gone])
        row, column, inside = chart.index_of(street)
        low = np.abs(street[:, 2] - chart.ground.height_at(street[:, 0], street[:, 1])) < 0.15 * limits.unit
        relit = (inside & low & (chart.gain[row, column].max(axis=1) > 1.02)).astype(np.uint8)
    seeds = concatenate(parts) if parts else left.select(torch.zeros(len(left), dtype=torch.bool))
    write_surfels(seeds, context.output("surfels/seeds.ply"), offset=drive.offset)
    save_array(relit, context.output("surfels/relit.npy"))


# ------------------------------------------------------------------------------------------------------------ reoptimize


def reoptimize_body(context: StageContext) -> None:
    """surfels/empty.ply; renders/ and frames/, each in its own photograph's exposure."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    full = read_surfels(workspace.surfels_full)
    sky = load_sky(workspace.root / "surfels/sky.npz")
    gone = load_array(workspace.root / "surfels/removed.npy").astype(bool)
    relit = load_array(workspace.root / "surfels/relit.npy").astype(bool)
    seeds = read_surfels(workspace.root / "surfels/seeds.ply")
    limits = scene_range(drive)
    preset = REOPTIMIZE_PRESETS[context.settings.quality]
    near = near_removed(full, gone, preset.near_m * limits.unit)[~gone]
    surfels = concatenate([full.select(torch.from_numpy(~gone)), seeds])
    movable = np.concatenate([near | relit, np.ones(len(seeds), dtype=bool)])
    exposures = read_exposures(workspace.exposure_json)
    clean = [read_image(frame_file(workspace.root / "inpainted", f)) for f in drive.frames]
    empty = reoptimize(
        surfels, movable, sky, [(f.camera, clean[i]) for i, f in enumerate(drive.frames)], preset,
        unit=limits.unit, near=limits.near, far=limits.far, label_count=len(scene.labels),
        seed=context.settings.seed, progress=context.progress,
    )  # fmt: skip
    write_surfels(empty, context.output("surfels/empty.ply"), offset=drive.offset)
    for i, frame in enumerate(drive.frames):
        picture = picture_of(empty, sky, frame.camera, near=limits.near, far=limits.far)
        write_image_atomic(frame_file(context.output("renders"), frame), exposures.delivered(frame, picture))
        removed = load_mask(frame_file(workspace.root / "masks/removed", frame))
        shadows = load_mask(frame_file(workspace.root / "masks/shadows", frame))
        photograph = read_image(frame.image_path)
        # Behind the objects the scene as all frames have taught it; its shadows were taken from the photograph itself.
        street = exposures.delivered(frame, np.where(removed[..., None], picture, clean[i]))
        delivered = compose_frame(photograph, street, removed | shadows)
        write_image_atomic(frame_file(context.output("frames"), frame), delivered)


# ---------------------------------------------------------------------------------------------------------- mesh, report


def mesh_body(context: StageContext) -> None:
    """meshes/full.ply, meshes/empty.ply, meshes/empty.glb."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    limits = scene_range(drive)
    voxel = MESH_VOXEL_M[context.settings.quality] * limits.unit
    for state, path in (("full", workspace.surfels_full), ("empty", workspace.surfels_empty)):
        surfels = read_surfels(path)
        mesh = fuse(
            depth_views(surfels, drive.frames, near=limits.near, far=limits.far), voxel_size=voxel, max_depth=30 * limits.unit,
            progress=context.progress,
        )  # fmt: skip
        write_ply(mesh, context.output(f"meshes/{state}.ply"), offset=drive.offset)
        if state == "empty":
            write_glb(mesh, context.output("meshes/empty.glb"), offset=drive.offset, up=drive.up)


def report_body(context: StageContext) -> None:
    """metrics.json and report/."""
    metrics = run_evaluation(context.workspace.root, None, context.progress)
    write_metrics(metrics, context.output("metrics.json"))
    write_report(context.workspace.root, context.output("report"), metrics, context.progress)


STAGES: tuple[Stage, ...] = (
    Stage("import", import_body, (), ("drive",), ("max_side", "quality"), drive_digest=True),
    Stage("segment", segment_body, ("drive",), ("labels.json",), ("remove", "instances")),
    Stage(
        "reconstruct", reconstruct_body, ("drive", "labels.json"),
        ("surfels/full.ply", "surfels/sky.npz", "surfels/exposure.json"),
        ("quality", "seed", "iterations", "sh_degree", "splats", "adapt"),
    ),
    Stage(
        "instances", instances_body, ("drive", "labels.json", "surfels/full.ply"),
        ("instances.json", "instances", "surfels/instances.npy"),
    ),
    Stage(
        "remove", remove_body, ("drive", "labels.json", "surfels/full.ply", "surfels/instances.npy"),
        ("surfels/removed.npy", "masks/removed", "masks/unobserved", "regions"),
    ),
    Stage(
        "inpaint", inpaint_body,
        ("drive", "labels.json", "surfels/full.ply", "surfels/sky.npz", "surfels/removed.npy", "surfels/instances.npy",
         "masks/removed", "masks/unobserved"),
        ("inpainted", "masks/shadows", "surfels/seeds.ply", "surfels/relit.npy"),
        ("quality", "shadows", "inpainter", "reference_inpainter", "order"), optional=("surfels/exposure.json",),
    ),
    Stage(
        "reoptimize", reoptimize_body,
        ("drive", "labels.json", "surfels/full.ply", "surfels/sky.npz", "surfels/removed.npy", "surfels/seeds.ply",
         "surfels/relit.npy", "inpainted", "masks/removed", "masks/shadows"),
        ("surfels/empty.ply", "renders", "frames"),
        ("quality", "seed"), optional=("surfels/exposure.json",),
    ),
    Stage(
        "mesh", mesh_body, ("drive", "surfels/full.ply", "surfels/empty.ply"),
        ("meshes/full.ply", "meshes/empty.ply", "meshes/empty.glb"), ("quality",),
    ),
    Stage(
        "report", report_body,
        ("drive", "frames", "renders", "inpainted", "masks", "regions", "instances.json", "meshes/full.ply",
         "meshes/empty.ply", "meshes/empty.glb", "surfels/empty.ply", "surfels/sky.npz"),
        ("metrics.json", "report"),
    ),
)  # fmt: skip
"""All stages in the order of their dependence."""
