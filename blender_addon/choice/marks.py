# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that nobody labelled: wire cubes that the artist puts around them, and mattes; written as the run reads them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..formats.boxes import EDGES, SIGNS, SceneBox, box_around
from ..formats.drive_files import ImportedDrive, read_drive
from ..formats.files import write_changed
from ..formats.object_files import read_marks
from ..scene import blocks
from .click_files import is_of_footage

__all__ = [
    "FILE",
    "FIRST_NUMBER",
    "alive",
    "box_of_marker",
    "free_number",
    "marked_entries",
    "new_marker",
    "restore",
    "write_marked",
]

FILE = "marked.json"
AS_MARKED = 40_000
"""Added to the ids of objects that a preview knows by their boxes: ids go up to 65535."""
FIRST_NUMBER = 1001
"""Ids of marks begin here, where few drives have ids of their own."""


def alive(marker: bpy.types.Object | None) -> bool:
    """Whether a wire cube is still in a scene: a deleted one lives on while a list points to it."""
    return marker is not None and bool(marker.users_collection)


def free_number(taken: Iterable[int]) -> int:
    """An id that no object has."""
    return max([FIRST_NUMBER - 1, *taken]) + 1


def new_marker(collection: bpy.types.Collection, number: int, class_name: str, box: SceneBox) -> bpy.types.Object:
    """A wire cube around something, in the drive's collection of marks; size and turn are the object's own."""
    drive = blocks.drive_of(collection)
    place = blocks.child_collection(collection, "marks", "Marked")
    mesh = blocks.find(bpy.data.meshes, drive, "mark")
    if mesh is None:
        mesh = bpy.data.meshes.new("Mark")
        blocks.mark(mesh, drive, "mark")
        mesh.from_pydata([tuple(v) for v in SIGNS], EDGES, [])
    thing = blocks.ensure_object(mesh, drive, f"mark:{number}", f"{class_name} {number}", place)
    thing.matrix_world = (
        Matrix.Translation(box.centre) @ Matrix.Rotation(box.yaw, 4, "Z") @ Matrix.Diagonal((*box.size, 1.0))
    )
    thing.display_type, thing.show_in_front, thing.hide_render = "WIRE", True, True
    thing.color = (1.0, 0.45, 0.05, 1.0)
    return thing


def box_of_marker(marker: bpy.types.Object) -> SceneBox:
    """The upright box around a wire cube as it stands now, however it was turned, scaled or edited."""
    matrix = _world(marker)
    along = matrix.to_3x3() @ Vector((1.0, 0.0, 0.0))
    yaw = math.atan2(along.y, along.x) if along.xy.length > 1e-6 else 0.0
    local = [v.co for v in marker.data.vertices] if len(marker.data.vertices) else [Vector(s) for s in SIGNS]
    return box_around(np.array([matrix @ co for co in local]), yaw)


def _world(thing: bpy.types.Object) -> Matrix:
    """Where an object is, also before the scene was evaluated anew after a change."""
    own = thing.matrix_basis
    return own if thing.parent is None else _world(thing.parent) @ thing.matrix_parent_inverse @ own


def write_marked(
    workspace: Path,
    objects: Sequence[Any],
    metre: float = 1.0,
    *,
    boxes: Mapping[int, tuple[str, SceneBox | None]] | None = None,
    into: Path | None = None,
) -> Path | None:
    """Write ``marked.json`` of a workspace: all marks among the objects of the list; None where there never were any.

    Args:
        metre: units of the scene.
        boxes: class and place of further objects, by id.
        into: another file than the workspace's.
    Raises:
        ValueError: the workspace has no imported drive.
        OSError: it cannot be written.
    """
    path = workspace / FILE if into is None else into
    if not boxes and not path.is_file() and not any(o.source in ("box", "mattes") for o in objects):
        return None
    entries = marked_entries(workspace, objects, metre)
    for number, (name, box) in (boxes or {}).items():
        if box is not None:
            entries.append({"id": number, "class": name, **_box_entry(_placed(workspace, metre), box)})
    write_changed(path, (json.dumps(entries, indent=1) + "\n").encode())
    return path


def marked_entries(workspace: Path, objects: Sequence[Any], metre: float = 1.0) -> list[dict[str, object]]:
    """The marks among the objects of the list, as the file has them. Arguments as :func:`write_marked`."""
    entries: list[dict[str, object]] = []
    for thing in (o for o in objects if o.source in ("box", "mattes")):
        entry: dict[str, object] = {"id": thing.number, "class": thing.class_name or "object"}
        if thing.source == "mattes":
            entry["mattes"] = os.path.realpath(bpy.path.abspath(thing.mattes))
            if is_of_footage(Path(entry["mattes"])):
                entry["of"] = "footage"
        else:
            entry |= _box_entry(_placed(workspace, metre), box_of_marker(thing.marker))
        entries.append(entry)
    return entries


def _box_entry(drive: ImportedDrive, box: SceneBox) -> dict[str, object]:
    size = [float(max(v, 1e-3)) * drive.units_per_metre / drive.metre for v in box.size]
    return {"centre": drive.to_drive(np.asarray(box.centre)).tolist(), "size": size, "yaw": box.yaw}


_drives: dict[tuple[str, int, float], ImportedDrive] = {}


def _placed(workspace: Path, metre: float) -> ImportedDrive:
    """The drive of a workspace, read again when it was imported again."""
    key = (str(workspace), (workspace / "drive" / "cameras.json").stat().st_mtime_ns, metre)
    if key not in _drives:
        _drives.clear()
        _drives[key] = read_drive(workspace, metre)
    return _drives[key]


def restore(scene: bpy.types.Scene, drive: ImportedDrive, path: Path | None = None) -> list[dict[str, Any]]:
    """The marks that a workspace has, or another file, with their wire cubes in the scene: properties of the list's entries."""
    collection = blocks.drive_collection(scene, str(drive.workspace.resolve()))
    if collection is None:
        return []
    found: list[dict[str, Any]] = []
    for mark in read_marks(drive, path):
        common = {"number": mark.number, "class_name": mark.class_name}
        if mark.box is None:
            found.append({**common, "source": "mattes", "mattes": mark.mattes})
            continue
        size = np.asarray(mark.box.size) / drive.units_per_metre * drive.metre
        box = SceneBox(tuple(drive.from_drive(np.asarray(mark.box.centre))), tuple(size), mark.box.yaw)
        marker = new_marker(collection, mark.number, mark.class_name, box)
        found.append({**common, "source": "box", "marker": marker})
    return found
