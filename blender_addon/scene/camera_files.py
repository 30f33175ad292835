# SPDX-License-Identifier: GPL-3.0-or-later
"""The cameras of a drive as Alembic, OpenUSD or FBX, by Blender's own exporters, with what those files cannot tell beside them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy

from ..formats.drive_files import ImportedDrive
from ..formats.files import write_whole
from ..formats.timeline import Timeline, timeline_of
from .drive_scene import tracks_of

__all__ = ["KINDS", "files_of", "write_cameras"]

KINDS = (".abc", ".usd", ".usda", ".usdc", ".fbx")


def files_of(path: Path) -> tuple[Path, Path]:
    """The file of cameras, and the one beside it that tells what it cannot."""
    return path, path.with_name(f"{path.name}.json")


def write_cameras(
    context: bpy.types.Context, collection: bpy.types.Collection, drive: ImportedDrive, path: Path
) -> Path:
    """Write the animated cameras of a drive, at the frames of the timeline that show its pictures.

    Args:
        collection: the drive in the scene; drive: the same as imported.
        path: with one of :data:`KINDS` as suffix.
    Returns:
        ``<path>.json``, which tells the origin, the units, the time stamps and the picture size.
    Raises:
        RuntimeError: the file cannot be written.
    """
    context.view_layer.update()  # objects that were removed since it was looked at last stand in it as None
    scene, cameras, things = context.scene, tracks_of(collection), context.view_layer.objects
    before = scene.frame_start, scene.frame_end, [thing.select_get() for thing in things]
    timeline = timeline_of(drive, scene.unveil.start_frame)
    scene.frame_start, scene.frame_end = timeline.start, timeline.end
    for thing in things:
        thing.select_set(thing in cameras)
    try:
        _write(path)
    finally:  # what the artist had set
        scene.frame_start, scene.frame_end, selected = before
        for thing, was in zip(things, selected, strict=True):
            thing.select_set(was)
    _, beside = files_of(path)
    write_whole(beside, (json.dumps(_told(drive, cameras, timeline), indent=1) + "\n").encode())
    return beside


def _write(path: Path) -> None:
    name = str(path)
    kind = path.suffix.lower()
    if kind == ".abc":
        scene = bpy.context.scene
        bpy.ops.wm.alembic_export(filepath=name, selected=True, start=scene.frame_start, end=scene.frame_end)
    elif kind == ".fbx":
        bpy.ops.export_scene.fbx(
            filepath=name,
            use_selection=True,
            object_types={"CAMERA"},
            bake_anim=True,
            bake_anim_use_nla_strips=False,
            bake_anim_use_all_actions=False,
            bake_anim_simplify_factor=0.0,  # each frame has its key
        )
    else:
        bpy.ops.wm.usd_export(filepath=name, selected_objects_only=True, export_animation=True, export_materials=False)


def _told(drive: ImportedDrive, cameras: list[bpy.types.Object], timeline: Timeline) -> dict[str, Any]:
    sizes = {c["unveil_track"]: [int(v) for v in c["unveil_size"]] for c in cameras}
    to_world = {
        "scale": drive.units_per_metre / drive.metre,
        "rotation": drive.rotation.tolist(),
        "translation": drive.offset.tolist(),
    }
    tracks = {
        name: {
            "size": sizes.get(name),
            "frames": [
                {"frame": n, "name": f.name, "timestamp": f.timestamp}
                for n, f in zip(timeline.frames[name], frames, strict=True)
            ],
        }
        for name, frames in drive.tracks.items()
    }
    return {
        "to_world": to_world,
        "note": "coordinates of the drive = scale * rotation * coordinates in the file + translation",
        "frame_rate": drive.frame_rate,
        "cameras": tracks,
    }
