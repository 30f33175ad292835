# SPDX-License-Identifier: GPL-3.0-or-later
"""Finding again what was made before: data blocks carry the drive and the part they play in it as custom properties.

Names are for people: Blender cuts and numbers them, and artists change them.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import bpy

from ..formats.open_safely import LARGEST_SCENE, open_file

__all__ = [
    "absolute",
    "as_preferred",
    "child_collection",
    "drive_collection",
    "drive_of",
    "ensure",
    "ensure_file",
    "ensure_object",
    "find",
    "is_own",
    "look_up",
    "mark",
    "remove",
    "resolved",
    "same_place",
    "strips",
    "workspace_of",
]

DRIVE, ROLE, WORKSPACE = "unveil_drive", "unveil_role", "unveil_workspace"


def mark(block: Any, drive: str, role: str) -> None:
    """Write what it is on a data block or strip."""
    block[DRIVE], block[ROLE] = drive, role


def is_own(block: Any) -> bool:
    """Whether a data block is this file's: one that is linked, or overrides a linked one, is another file's to change."""
    return getattr(block, "library", None) is None and getattr(block, "override_library", None) is None


def find(blocks: Any, drive: str, role: str) -> Any:
    """The one of that role, None where there is none."""
    return next((b for b in blocks if b.get(ROLE) == role and b.get(DRIVE) == drive and is_own(b)), None)


def ensure(blocks: Any, drive: str, role: str, make: Any) -> Any:
    """The one of that role, made by ``make()`` where there is none."""
    block = find(blocks, drive, role)
    if block is None:
        block = make()
        mark(block, drive, role)
    return block


def ensure_object(data: Any, drive: str, role: str, name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    """The object of that role, with this data, in this collection."""
    thing = ensure(bpy.data.objects, drive, role, lambda: bpy.data.objects.new(name, data))
    if thing.data != data:
        thing.data = data
    if collection not in thing.users_collection:
        collection.objects.link(thing)
    return thing


def ensure_file(blocks: Any, drive: str, role: str, path: str, name: str) -> Any:
    """The picture or clip of that role, of this file.

    Raises:
        OSError: it is not there, or a link, a pipe or a device, at which Blender would wait for ever.
    """
    open_file(path, LARGEST_SCENE).close()
    block = find(blocks, drive, role)
    if block is None:
        block = blocks.load(path)
        block.filepath = as_preferred(path)
        block.name = name
        mark(block, drive, role)
    elif not same_place(block.filepath, path):
        block.filepath = as_preferred(path)
    return block


def remove(blocks: Any, block: Any) -> None:
    """Take a data block away, where there is one."""
    if block is not None:
        blocks.remove(block)


def as_preferred(path: str) -> str:
    """A path relative to the .blend where Blender's preference says so and there is one."""
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return path
    try:
        return str(bpy.path.relpath(path))
    except ValueError:  # on another drive
        return path


def absolute(path: str) -> Path:
    """A path as Blender has it, which may start at the .blend."""
    return Path(bpy.path.abspath(path)).absolute()


_resolved: dict[str, str] = {}


def look_up(paths: Iterable[str]) -> None:
    """Find out where paths lead, links followed: drawing goes by what was found then, for a disk may be far away."""
    for path in paths:
        if path:
            absolute = bpy.path.abspath(path)
            _resolved[absolute] = os.path.normcase(os.path.realpath(absolute))


def resolved(path: str) -> str:
    """Where a path leads, as far as that was looked up; else as it is written."""
    absolute = bpy.path.abspath(path)
    return _resolved.get(absolute) or os.path.normcase(os.path.normpath(absolute))


def same_place(a: str, b: str) -> bool:
    """Whether two paths lead to one file or folder, as far as :func:`look_up` knows them."""
    return resolved(a) == resolved(b)


def strips(scene: bpy.types.Scene) -> list[Any]:
    """All strips of a scene's sequence editor, those in meta strips too; none where there is no editor."""
    editor = scene.sequence_editor
    return [] if editor is None else list(getattr(editor, "strips_all", None) or getattr(editor, "sequences_all", ()))


def workspace_of(collection: bpy.types.Collection) -> str:
    """Absolute path of the workspace that a drive's collection shows."""
    return str(os.path.abspath(bpy.path.abspath(str(collection.get(WORKSPACE, "")))))


def drive_of(collection: bpy.types.Collection) -> str:
    """The drive's mark on its data blocks."""
    return str(collection.get(DRIVE, ""))


def drive_collection(
    scene: bpy.types.Scene, workspace: str, name: str = "", source: str = ""
) -> bpy.types.Collection | None:
    """The collection of a workspace's drive in a scene; made where there is none and a name is given.

    One whose workspace is gone but whose drive is the same was moved with its workspace, and is taken over.
    """
    drives = [c for c in scene.collection.children_recursive if c.get(ROLE) == "drive" and is_own(c)]
    for collection in drives:
        if same_place(str(collection.get(WORKSPACE, "")), workspace):
            return collection
    if not name:
        return None
    for collection in drives:
        if collection.get("unveil_source") == source and not os.path.isdir(workspace_of(collection)):
            collection[WORKSPACE] = workspace
            return collection
    collection = bpy.data.collections.new(name)
    mark(collection, _left_behind(workspace) or uuid.uuid4().hex[:12], "drive")
    collection[WORKSPACE], collection["unveil_source"] = workspace, source
    scene.collection.children.link(collection)
    return collection


def _left_behind(workspace: str) -> str | None:
    """The mark of pictures of a workspace whose drive's collection was deleted: they are not to be there twice."""
    used = {c.get(DRIVE) for c in bpy.data.collections if c.get(ROLE) == "drive"}
    inside = os.path.join(os.path.realpath(workspace), "")
    for block in (*bpy.data.images, *bpy.data.movieclips):
        own = block.get(DRIVE)
        if (
            own
            and own not in used
            and is_own(block)
            and os.path.realpath(bpy.path.abspath(block.filepath)).startswith(inside)
        ):
            return str(own)
    return None


def child_collection(parent: bpy.types.Collection, role: str, name: str) -> bpy.types.Collection:
    """A collection within a drive's."""
    child = find(parent.children_recursive, drive_of(parent), role)
    if child is None:
        child = bpy.data.collections.new(name)
        mark(child, drive_of(parent), role)
        parent.children.link(child)
    return child
