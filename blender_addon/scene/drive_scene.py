# SPDX-License-Identifier: GPL-3.0-or-later
"""An imported drive in the scene: a collection with its cameras, its points and what could be removed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..formats import classes, sequences, splats
from ..formats.drive_files import ImportedDrive
from ..formats.files import file_stamp
from ..formats.object_files import read_source
from ..formats.open_safely import LARGEST_SCENE, open_file
from ..formats.ply_file import read_ply
from ..formats.timeline import Timeline, timeline_of
from . import blocks, cameras, meshes
from .cg import aside
from .images import plates

__all__ = [
    "MOST_POINTS",
    "Placed",
    "looks_through_camera",
    "metre_of",
    "place",
    "set_up",
    "show_cameras_view",
    "tracks_of",
]

MOST_POINTS = 400_000
"""More points of a drive are thinned evenly: so many take 10 MB of a .blend."""
POINTS_FROM = ("drive/points.ply", "drive/cameras.json", "objects/point_labels.npy", "objects.json")
"""Files that the mesh of points is made from."""
AHEAD_M = 12.0
"""How far before the camera a view turns around that is moved out of it: the street, not the horizon."""


@dataclass(frozen=True)
class Placed:
    """A drive in the scene.

    Attributes:
        collection: that holds it.
        tracks: its cameras, in the drive's order.
        resized: those of them whose pictures have another size than when the drive was placed before.
        timeline: which frame shows which picture.
        new: whether the drive was not there before.
    """

    collection: bpy.types.Collection
    tracks: list[bpy.types.Object]
    resized: list[bpy.types.Object]
    timeline: Timeline
    new: bool


def metre_of(scene: bpy.types.Scene) -> float:
    """Units of a scene in a metre."""
    units = scene.unit_settings
    return 1.0 if units.system == "NONE" else 1.0 / float(units.scale_length)


def place(scene: bpy.types.Scene, drive: ImportedDrive) -> Placed:
    """Bring a drive into the scene, or up to date where it is there: its cameras with the photographs, and its points.

    Nothing of the scene's own is changed: see :func:`set_up`.

    Raises:
        ValueError: a file of it is damaged; one line that names it.
        OSError: a file cannot be read or a copy not be made.
    """
    workspace = str(drive.workspace.resolve())
    blocks.look_up(
        [scene.unveil.workspace, workspace, *(str(c.get(blocks.WORKSPACE, "")) for c in bpy.data.collections)]
    )
    before = blocks.drive_collection(scene, workspace)
    collection = before or blocks.drive_collection(scene, workspace, drive.name, drive.source)
    assert collection is not None
    mark = blocks.drive_of(collection)
    collection["unveil_offset"] = [float(v) for v in drive.offset]  # double precision
    collection["unveil_units_per_metre"] = drive.units_per_metre
    sizes = {c.name: list(c["unveil_size"]) for c in tracks_of(collection)}
    timeline = timeline_of(drive, scene.unveil.start_frame)
    tracks = _cameras(collection, mark, drive, timeline)
    _points(collection, mark, drive)
    resized = [c for c in tracks if sizes.get(c.name) != list(c["unveil_size"])]
    return Placed(collection, tracks, resized, timeline, before is None)


def set_up(context: bpy.types.Context, placed: Placed) -> None:
    """Fit the scene to a drive: camera, picture size, frame range and rate and, the first time, how its views show it.

    Called where *Set up scene* is on. What the artist has set since the drive was imported stays.
    """
    scene, collection, tracks = context.scene, placed.collection, placed.tracks
    span = [placed.timeline.start, max(placed.timeline.end, placed.timeline.start + 1)]
    if list(collection.get("unveil_frames", ())) != span:
        collection["unveil_frames"] = span
        scene.frame_start, scene.frame_end = span
        _set_rate(scene, placed.timeline.rate)
    if placed.new:
        aside.put_aside(scene)
        _first_look(context, placed)
    if scene.camera is None or (cameras.track_of(scene.camera) and scene.camera not in tracks and placed.new):
        scene.camera = tracks[0]
    if scene.camera in placed.resized:
        cameras.fit_scene_to(scene, scene.camera)


def _set_rate(scene: bpy.types.Scene, rate: float | None) -> None:
    """Frames a second: a whole number over a base near one, as Blender has it."""
    if rate and 1 <= round(rate) <= 32767:
        scene.render.fps = round(rate)
        scene.render.fps_base = round(rate) / rate


def tracks_of(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """The cameras of a drive."""
    return [o for o in collection.all_objects if cameras.track_of(o) is not None]


def _cameras(
    collection: bpy.types.Collection, mark: str, drive: ImportedDrive, timeline: Timeline
) -> list[bpy.types.Object]:
    place = blocks.child_collection(collection, "cameras", "Cameras")
    found = []
    for track, frames in drive.tracks.items():
        camera = cameras.track_camera(place, mark, track, frames, timeline.frames[track], drive.metre)
        files = timeline.held(track, [f.image for f in frames])
        pictures = sequences.numbered(files, drive.workspace, "blender", "original", track)
        plates.set_plate(camera, mark, "original", pictures, timeline.first(track))
        if not any(b.show_background_image for b in camera.data.background_images):
            plates.show_plate(camera, "original")
        found.append(camera)
    for camera in tracks_of(collection):  # of a drive that had more tracks once
        if camera not in found:
            blocks.remove(bpy.data.objects, camera)
    return found


def _points(collection: bpy.types.Collection, mark: str, drive: ImportedDrive) -> None:
    mesh = blocks.ensure(bpy.data.meshes, mark, "points", lambda: bpy.data.meshes.new("Points"))
    place = blocks.child_collection(collection, "points", "Points")
    thing = blocks.ensure_object(mesh, mark, "points", "Points", place)
    stamps = [file_stamp(drive.workspace / name) for name in POINTS_FROM]
    stamp = " ".join([*stamps, f"{drive.metre:g}", str(MOST_POINTS), "dots"])
    if mesh.get("unveil_stamp") != stamp or "unveil_points" not in thing:
        _fill_points(mesh, thing, drive)
        mesh["unveil_stamp"] = stamp
    thing.hide_select = True  # they are everywhere, and a click means something else
    thing.hide_viewport = True  # Blender draws bare vertices as black dots; see overlays/points
    meshes.show_colors(mesh, "Class" if bpy.context.scene.unveil_view.points == "CLASS" else "Colour")


def _fill_points(mesh: bpy.types.Mesh, thing: bpy.types.Object, drive: ImportedDrive) -> None:
    whole = read_ply(drive.workspace / "drive" / "points.ply")
    chosen = splats.fair_share(len(whole.vertices), MOST_POINTS)
    ply = whole.some(chosen)
    meshes.fill_mesh(mesh, ply.positions * drive.metre, np.zeros((0, 3), np.int32))
    colors = ply.colors
    labels = _point_labels(drive.workspace, len(whole.vertices))[chosen]
    meshes.set_colors(mesh, "Colour", np.full((len(chosen), 3), 160, np.uint8) if colors is None else colors)
    meshes.set_colors(mesh, "Class", classes.color_table(read_source(drive))[labels])
    meshes.set_values(mesh, "label", labels.astype(np.int32), "POINT")
    thing["unveil_points"], thing["unveil_points_shown"] = len(whole.vertices), len(chosen)


def _point_labels(workspace: Path, count: int) -> np.ndarray:
    """(P,) numbers of classes, 255 where none is known."""
    try:
        with open_file(workspace / "objects" / "point_labels.npy", LARGEST_SCENE) as stream:
            labels = np.load(stream, allow_pickle=False)
    except (OSError, ValueError):
        labels = np.zeros(0, np.uint8)
    return labels if labels.shape == (count,) else np.full(count, 255, np.uint8)


def _first_look(context: bpy.types.Context, placed: Placed) -> None:
    """How the scene is seen right after an import; what the artist changes then stays.

    The view transform is the artist's: Blender draws pictures behind a camera, and solid colours, without it.
    """
    scene, camera = context.scene, placed.tracks[0]
    scene.camera = camera
    scene.frame_set(placed.timeline.start)
    farthest = cameras.FARTHEST_M * metre_of(scene)
    for area in _areas(context):
        space = area.spaces.active
        space.shading.type, space.shading.color_type, space.shading.light = "SOLID", "VERTEX", "FLAT"
        space.shading.show_object_outline = False  # drawn along every edge of a mesh that has holes
        space.clip_end = max(space.clip_end, farthest)
        space.region_3d.view_distance = AHEAD_M * metre_of(scene)
    show_cameras_view(context)
    for area in _areas(context):
        _fill(area, *camera["unveil_size"])
    _show_range(context)


def _show_range(context: bpy.types.Context) -> None:
    """Let the timelines show the frame range: that of a drive begins far beyond a new file's."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            region = next((r for r in area.regions if r.type == "WINDOW"), None)
            if window.scene != context.scene or area.type != "DOPESHEET_EDITOR" or region is None:
                continue
            with context.temp_override(window=window, area=area, region=region):
                if bpy.ops.anim.scene_range_frame.poll():
                    bpy.ops.anim.scene_range_frame()


def _fill(area: bpy.types.Area, width: int, height: int) -> None:
    """Zoom a camera's view until a picture of that size fills what the sidebar leaves free."""
    whole = next(r for r in area.regions if r.type == "WINDOW")
    sidebar = next((r.width for r in area.regions if r.type == "UI"), 0)
    overlaps = bpy.context.preferences.system.use_region_overlap
    covered = sidebar if overlaps and area.spaces.active.show_region_ui else 0
    fraction = min(0.92 * (whole.width - covered) / whole.width, 0.8 * whole.height * width / height / whole.width)
    if fraction <= 0.1:  # no room for a picture
        return
    view = area.spaces.active.region_3d
    view.view_camera_zoom = 50 * (2 * fraction**0.5 - 2**0.5)  # Blender's measure: 0 is half of the width
    view.view_camera_offset = (covered / (4 * whole.width * fraction), 0.0)


def show_cameras_view(context: bpy.types.Context) -> None:
    """Look through the scene's camera in every 3D view."""
    for space in _viewports(context):
        space.region_3d.view_perspective = "CAMERA"


def looks_through_camera(context: bpy.types.Context) -> bool:
    """Whether every 3D view does, and there is one."""
    seen = [space.region_3d.view_perspective for space in _viewports(context)]
    return bool(seen) and all(perspective == "CAMERA" for perspective in seen)


def _areas(context: bpy.types.Context) -> list[bpy.types.Area]:
    """The 3D views of the scene; those of windows that show another one are none of the drive's business."""
    windows = [w for w in context.window_manager.windows if w.scene == context.scene]
    return [a for w in windows for a in w.screen.areas if a.type == "VIEW_3D"]


def _viewports(context: bpy.types.Context) -> list[bpy.types.SpaceView3D]:
    return [area.spaces.active for area in _areas(context)]
