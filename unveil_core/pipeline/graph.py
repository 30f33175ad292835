"""What each stage reads, computes and writes. The computing lives in the modules below; the order in ``stages``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from unveil_core.base.files import write_json_atomic
from unveil_core.drives import open_drive
from unveil_core.drives.exposure import write_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing import import_drive
from unveil_core.drives.scene_range import scene_range
from unveil_core.evaluate import run_evaluation, write_metrics
from unveil_core.mesh import fuse, write_glb, write_ply
from unveil_core.mesh.views import depth_views
from unveil_core.optimize.adaptation.choices import CHOICES
from unveil_core.optimize.exposure import fit_exposures
from unveil_core.optimize.reconstruct import PRESETS, ReconstructSettings, reconstruct
from unveil_core.pipeline.runner import Stage, StageContext
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.steps.objects import instances_body, known_objects, objects_body
from unveil_core.pipeline.steps.unveil import inpaint_body, remove_body, reoptimize_body
from unveil_core.report import write_report
from unveil_core.semantics.labels import choose_labels, find_labels
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import save_sky
from unveil_core.workspace.files import load_labels
from unveil_core.workspace.movers import read_moving, write_moving

MESH_VOXEL_M = {"draft": 0.12, "standard": 0.08, "high": 0.05}
"""Edge of a voxel of the fused meshes, metres."""
MAX_SIDE = {"draft": 512, "standard": 768, "high": 1600}
"""Longer image side that larger images are reduced to, pixels."""


# ---------------------------------------------------------------------------------------------------------------- import


def import_body(context: StageContext) -> None:
    """drive/: undistorted, recentred."""
    side = context.settings.max_side or MAX_SIDE[context.settings.quality]
    import_drive(open_drive(context.drive), context.output("drive"), max_side=side, progress=context.progress)


def segment_body(context: StageContext) -> None:
    """labels.json: which labels occur; movers/: what moves."""
    drive = read_imported(context.workspace.drive_dir)
    scene = find_labels(drive)
    write_json_atomic(context.output("labels.json"), scene.labels_json())
    movers = write_moving(drive, scene, context.output("movers"), context.settings.movers, context.progress)
    context.workspace.update_stage("segment", movers=movers)


def choose_body(context: StageContext) -> None:
    """selection.json: what goes. It is no part of labels.json, so that another choice does not make the scene anew."""
    drive = read_imported(context.workspace.drive_dir)
    settings = context.settings
    scene = choose_labels(drive, settings.remove, settings.instances, known=known_objects(context.workspace))
    write_json_atomic(context.output("selection.json"), scene.selection_json())


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
    moving = read_moving(context.workspace.root)
    drive = moving.standing(read_imported(context.workspace.drive_dir))
    scene, hidden = load_labels(context.workspace), moving.hidden(drive)
    exposures = fit_exposures(drive, hidden=hidden, progress=context.progress)
    write_exposures(exposures, context.output("surfels/exposure.json"))
    done = reconstruct(
        drive,
        scene,
        settings,
        exposures=exposures,
        hidden=hidden,
        seed=context.settings.seed,
        progress=context.progress,
    )
    comments = (f"labels {','.join(n.replace(' ', '_') for n in scene.labels.names)}",)
    write_surfels(done.surfels, context.output("surfels/full.ply"), offset=drive.offset, comments=comments)
    save_sky(done.sky, context.output("surfels/sky.npz"))
    context.workspace.update_stage("reconstruct", choices=done.choices)


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
    Stage("objects", objects_body, ("drive",), ("objects.json", "objects"), ("marked",), version=2),
    Stage("segment", segment_body, ("drive",), ("labels.json", "movers"), ("movers",), version=2),
    Stage("choose", choose_body, ("drive", "objects.json"), ("selection.json",), ("remove", "instances")),
    Stage(
        "reconstruct", reconstruct_body, ("drive", "labels.json"),
        ("surfels/full.ply", "surfels/sky.npz", "surfels/exposure.json"),
        ("quality", "seed", "iterations", "sh_degree", "splats", "adapt"), optional=("movers",),
    ),
    Stage(
        "instances", instances_body,
        ("drive", "labels.json", "selection.json", "objects.json", "objects", "surfels/full.ply"),
        ("instances.json", "instances", "surfels/instances.npy"), ("marked",), version=2, optional=("movers",),
    ),
    Stage(
        "remove", remove_body,
        ("drive", "labels.json", "selection.json", "objects.json", "surfels/full.ply", "surfels/instances.npy"),
        ("surfels/removed.npy", "masks/removed", "masks/unobserved", "regions"), ("marked",), version=3,
        optional=("movers",),
    ),
    Stage(
        "inpaint", inpaint_body,
        ("drive", "labels.json", "surfels/full.ply", "surfels/sky.npz", "surfels/removed.npy", "surfels/instances.npy",
         "masks/removed", "masks/unobserved"),
        ("inpainted", "inpaint/keyframes.json", "masks/shadows", "surfels/seeds.ply", "surfels/displaced.npy",
         "surfels/relit.npy"),
        ("quality", "shadows", "inpainter", "reference_inpainter", "order", "keyframes"),
        optional=("surfels/exposure.json", "movers"),
    ),
    Stage(
        "reoptimize", reoptimize_body,
        ("drive", "labels.json", "surfels/full.ply", "surfels/sky.npz", "surfels/removed.npy", "surfels/seeds.ply",
         "surfels/displaced.npy", "surfels/relit.npy", "inpainted", "masks/removed", "masks/shadows"),
        ("surfels/empty.ply", "renders", "frames"),
        ("quality", "seed"), optional=("surfels/exposure.json", "movers"),
    ),
    Stage(
        "mesh", mesh_body, ("drive", "surfels/full.ply", "surfels/empty.ply"),
        ("meshes/full.ply", "meshes/empty.ply", "meshes/empty.glb"), ("quality",), version=2,
    ),
    Stage(
        "report", report_body,
        ("drive", "frames", "renders", "inpainted", "masks", "regions", "instances.json", "meshes/full.ply",
         "meshes/empty.ply", "meshes/empty.glb", "surfels/empty.ply", "surfels/sky.npz"),
        ("metrics.json", "report"),
    ),
)  # fmt: skip
"""All stages in the order of their dependence."""
