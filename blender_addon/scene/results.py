# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run has made, in the scene: plates, strips, clips, meshes and Gaussians. What is there already is brought up to date."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ..formats import sequences, splats
from ..formats.decimation import decimated
from ..formats.drive_files import ImportedDrive
from ..formats.files import file_stamp, own_folder
from ..formats.gaussians import gaussians_of
from ..formats.object_files import read_keyframes
from ..formats.ply_file import read_ply
from ..formats.splat_files.splat_facts import facts_of
from ..formats.timeline import Timeline
from . import blocks, drive_scene, meshes, splat_clouds, versions, view
from .images import plates, preview, versions_kept

__all__ = ["FOLDERS", "load", "load_mesh"]

FOLDERS = {
    "clean": "frames",
    "render": "renders",
    "inpainted": "inpainted",
    "regions": "regions",
    "provenance": "provenance",
    "removed": "masks/removed",
    "shadows": "masks/shadows",
    "unobserved": "masks/unobserved",
}
"""Where the workspace keeps each kind of plate."""
WITHOUT_LENS = {**FOLDERS, "clean": "clean"}
"""The same for footage with a lens: delivered frames are in it, and would not fit behind the camera."""
CLIPS = ("clean", "regions", "removed", "unobserved")
"""Kinds that become movie clips, too, for tracking and compositing."""
STATES = {"full": "before", "empty": "after"}
MOST_TRIANGLES = 500_000
"""A mesh of more is decimated for the view: so many take 31 MB of a .blend, and a street of 400 m has cells of 0.27 m."""


def load(context: bpy.types.Context, placed: drive_scene.Placed, drive: ImportedDrive) -> list[str]:
    """Bring whatever stages have made of a drive into the scene.

    Args:
        placed: the drive there.
    Returns:
        what is there, by kind.
    Raises:
        ValueError: a file is damaged; one line that names it.
        OSError: a file cannot be read, or a copy not be made.
    """
    scene, collection, timeline = context.scene, placed.collection, placed.timeline
    mark = blocks.drive_of(collection)
    found: list[str] = []
    for camera in drive_scene.tracks_of(collection):
        found += _plates(camera, mark, drive, timeline) + preview.load(camera, mark, drive, timeline)
        if scene.unveil.set_up_scene:
            _strips(context, camera, mark, drive, timeline)
    _keyframes(scene, mark, drive, timeline)
    collection[versions_kept.KEPT] = versions_kept.numbers_in(drive.workspace)
    collection[view.FIGURES] = file_stamp(drive.workspace / "metrics.json")
    for state in STATES:
        found += load_mesh(collection, drive, state)
        found += _splats(collection, mark, drive, state)
    if "mesh:empty" in found and not collection.get("unveil_results"):
        collection["unveil_results"] = True
        # A mesh would cover the clean frames, which are sharper: whoever looks through the camera sees those first.
        covers = "clean" in found and drive_scene.looks_through_camera(context)
        scene.unveil_view.state, scene.unveil_view.shown = "AFTER", set() if covers else {"MESH"}
    if "clean" in found and not collection.get("unveil_clean"):
        collection["unveil_clean"] = True
        scene.unveil_view.background = "clean"
    view.apply(scene)
    return found


# ---------------------------------------------------------------------------------------------------------------- pictures


def _plates(camera: bpy.types.Object, mark: str, drive: ImportedDrive, timeline: Timeline) -> list[str]:
    """Put each kind of picture that is there behind a track's camera, and make clips of some."""
    track = str(camera["unveil_track"])
    names = [f.name for f in drive.tracks[track]]
    in_lens = any(f.in_lens for f in drive.tracks[track])
    delivered = all((drive.workspace / FOLDERS["clean"] / track / f"{name}.png").is_file() for name in names)
    camera["unveil_in_lens"], camera["unveil_delivered"] = in_lens, delivered  # panels ask, and touch no disk
    found = []
    for kind, place in (WITHOUT_LENS if in_lens else FOLDERS).items():
        files = [drive.workspace / place / track / f"{name}.png" for name in names]
        if not all(f.is_file() for f in files):
            continue
        if kind in sequences.COLORS:
            files = _in_color(kind, files, own_folder(drive.workspace, "blender", kind, f"{track}_colours"))
        pictures = sequences.numbered(timeline.held(track, files), drive.workspace, "blender", kind, track)
        plates.set_plate(camera, mark, kind, pictures, timeline.first(track))
        if kind in CLIPS:
            _clip(mark, kind, track, pictures, timeline.first(track))
        found.append(kind)
    return found


def _in_color(kind: str, files: list[Path], folder: Path) -> list[Path]:
    """Copies of pictures of numbers that show their numbers in colours, in a folder whose names are the frames'."""
    made = [folder / file.name for file in files]
    for file, target in zip(files, made, strict=True):
        sequences.in_color(file, target, sequences.COLORS[kind])
    return made


def _clip(mark: str, kind: str, track: str, pictures: sequences.PictureSequence, start: int) -> None:
    """A movie clip of a sequence; it stays in the file though nothing uses it."""
    role = f"clip:{kind}:{track}"
    clip = blocks.ensure_file(bpy.data.movieclips, mark, role, str(pictures.files[0]), f"{track} {kind}")
    clip.use_fake_user, clip.frame_start, clip.frame_offset = True, start, 0
    plates.set_color_space(clip, kind)


def _strips(
    context: bpy.types.Context, camera: bpy.types.Object, mark: str, drive: ImportedDrive, timeline: Timeline
) -> None:
    """The footage and, above it, the delivered frames in the Video Sequencer."""
    scene, track = context.scene, str(camera["unveil_track"])
    frames = drive.tracks[track]
    shown = {
        "original": [f.footage for f in frames],
        "clean": [drive.workspace / FOLDERS["clean"] / track / f"{f.name}.png" for f in frames],
    }
    if not all(f.is_file() for files in shown.values() for f in files):
        return
    end = "_in_lens" if any(f.in_lens for f in frames) else ""
    strips = versions.strips_of(scene)
    if not len(strips):  # F12 goes on to render the scene, not these pictures
        scene.render.use_sequencer = False
    versions.show_in_sequencer(context, scene)
    for kind, pictures in shown.items():
        role = f"strip:{kind}:{track}"
        held = timeline.held(track, pictures)
        files = sequences.numbered(held, drive.workspace, "blender", f"{kind}{end}", track).files
        strip = blocks.find(strips, mark, role)
        if strip is not None and versions.strip_files(strip) == [str(f) for f in files]:
            versions.place_strip(strip, timeline.first(track))
            continue
        channel = _free_channel(strips) if strip is None else strip.channel
        if strip is not None:
            strips.remove(strip)
        strip = strips.new_image(
            name=f"{track} {kind}", filepath=str(files[0]), channel=channel, frame_start=timeline.first(track)
        )
        for file in files[1:]:
            strip.elements.append(file.name)
        versions.place_strip(strip, timeline.first(track), len(files))
        strip.directory = blocks.as_preferred(str(files[0].parent))
        blocks.mark(strip, mark, role)


def _free_channel(strips: object) -> int:
    used = {s.channel for s in strips}  # type: ignore[attr-defined]
    return max(used, default=0) + 1


def _keyframes(scene: bpy.types.Scene, mark: str, drive: ImportedDrive, timeline: Timeline) -> None:
    """What the keyframes invented, as pictures of their own, and a marker in the timeline for each."""
    wanted = {}
    for track, name in read_keyframes(drive.workspace):
        order = [f.name for f in drive.tracks.get(track, ())]
        file = drive.workspace / "inpainted" / track / f"{name}.png"
        if name in order and file.is_file():
            frame = timeline.frames[track][order.index(name)]
            wanted[f"keyframe:{track}:{name}"] = (_fill(frame), file, frame)
    for image in [i for i in bpy.data.images if i.get(blocks.DRIVE) == mark]:
        if str(image[blocks.ROLE]).startswith("keyframe:") and image[blocks.ROLE] not in wanted:
            bpy.data.images.remove(image)
    for role, (name, file, _) in wanted.items():
        image = blocks.ensure_file(bpy.data.images, mark, role, str(file), name)
        image.use_fake_user = True
        plates.reload_changed(image, [file])
    # Markers cannot carry custom properties: one is known by its name and frame, and where any is, none is added.
    names = {(_fill(frame), frame) for track in drive.tracks for frame in timeline.frames[track]}
    gone = names - {(name, frame) for name, _, frame in wanted.values()}
    for marker in [m for m in scene.timeline_markers if (m.name, m.frame) in gone]:
        scene.timeline_markers.remove(marker)
    taken = {m.frame for m in scene.timeline_markers}
    for name, _, frame in wanted.values():
        if frame not in taken:
            scene.timeline_markers.new(name, frame=frame)


def _fill(frame: int) -> str:
    """What a frame of the timeline is called that fills holes for others: a keyframe is something else in Blender."""
    return f"Fill {frame}"


# ---------------------------------------------------------------------------------------------------------------- geometry


def _stamp(path: Path, drive: ImportedDrive) -> str:
    return f"{file_stamp(path)} {drive.metre:g}"


def load_mesh(collection: bpy.types.Collection, drive: ImportedDrive, state: str) -> list[str]:
    """The fused mesh of a state, in a collection of its own; decimated for the view where it is not wanted in full detail.

    Raises:
        ValueError: its file is damaged; one line that names it.
        OSError: that cannot be read.
    """
    mark = blocks.drive_of(collection)
    path, role = drive.workspace / "meshes" / f"{state}.ply", f"mesh:{state}"
    if not path.is_file():
        return []
    name = f"Mesh {STATES[state]}"
    mesh = blocks.ensure(bpy.data.meshes, mark, role, lambda: bpy.data.meshes.new(name))
    thing = blocks.ensure_object(mesh, mark, role, name, blocks.child_collection(collection, role, name))
    most = None if thing.get(view.FULL_DETAIL) else MOST_TRIANGLES
    stamp = f"{_stamp(path, drive)} {most}"
    if mesh.get("unveil_stamp") == stamp and "unveil_triangles" in thing:
        return [role]
    ply = read_ply(path)
    places, triangles, colors = ply.positions, ply.triangles, ply.colors
    if most is not None:
        shown = decimated(places, triangles, colors, most)
        places, triangles, colors = shown.vertices, shown.triangles, shown.colors
    meshes.fill_mesh(mesh, drive.from_drive(places), triangles)
    meshes.set_colors(mesh, "Col", np.full((len(places), 3), 160, np.uint8) if colors is None else colors)
    thing["unveil_triangles"], thing["unveil_triangles_shown"] = len(ply.triangles), len(triangles)
    _finish(mesh, mark, stamp)
    return [role]


def _splats(collection: bpy.types.Collection, mark: str, drive: ImportedDrive, state: str) -> list[str]:
    """The Gaussians of a state, in a Blender that draws them: as faces they look like a street that failed."""
    path, role = drive.workspace / "surfels" / f"{state}.ply", f"splats:{state}"
    _drop_squares(mark, role)
    if not path.is_file() or not versions.has_native_splats():
        return []
    _native_splats(collection, mark, drive, role, path)
    return [role]


def _drop_squares(mark: str, role: str) -> None:
    """Take away what a version before has made as a mesh: an object cannot change into a point cloud."""
    thing = blocks.find(bpy.data.objects, mark, role)
    if thing is not None and thing.type == "MESH":
        mesh = thing.data
        bpy.data.objects.remove(thing)
        if not mesh.users and blocks.is_own(mesh):
            bpy.data.meshes.remove(mesh)


def _native_splats(collection: bpy.types.Collection, mark: str, drive: ImportedDrive, role: str, path: Path) -> None:
    name = f"Gaussians {STATES[path.stem]}"
    cloud = blocks.find(bpy.data.pointclouds, mark, role)
    stamp = _stamp(path, drive)
    if cloud is None or cloud.get("unveil_stamp") != stamp:
        ply = read_ply(path)
        chosen = splats.fair_share(len(ply.vertices), splat_clouds.MOST_NATIVE)
        try:
            found = gaussians_of(ply, drive.metre, chosen, _camera_places(drive))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
        before, cloud = cloud, splat_clouds.make(name, found, facts_of(drive.workspace, path.stem, ply, chosen))
        blocks.mark(cloud, mark, role)
        cloud["unveil_stamp"], cloud["unveil_gaussians"] = stamp, len(ply.vertices)
        if before is not None:
            for material in before.materials:
                cloud.materials.append(material)
            before.user_remap(cloud)
            bpy.data.pointclouds.remove(before)
            cloud.name = name
    thing = blocks.ensure_object(cloud, mark, role, name, blocks.child_collection(collection, role, name))
    thing["unveil_gaussians"], thing["unveil_gaussians_shown"] = cloud["unveil_gaussians"], len(cloud.points)


def _camera_places(drive: ImportedDrive) -> np.ndarray:
    """(C, 3) where a drive's cameras are, metres."""
    return np.array([f.camera_to_scene[:3, 3] for t in drive.tracks.values() for f in t]).reshape(-1, 3) / drive.metre


def _finish(mesh: bpy.types.Mesh, mark: str, stamp: str) -> None:
    meshes.show_colors(mesh, "Col")
    if not mesh.materials:
        mesh.materials.append(meshes.color_material(mark, "Street"))
    mesh["unveil_stamp"] = stamp
