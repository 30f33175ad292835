# SPDX-License-Identifier: GPL-3.0-or-later
"""A workspace that was moved together with its .blend: whatever in the file leads into it leads there again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy

from ...scene import blocks

__all__ = ["find_moved_workspaces", "follow"]


def find_moved_workspaces() -> None:
    """Where a scene's workspace is gone and one of its name lies beside the .blend: take that, and all that it holds."""
    if not bpy.data.filepath:
        return
    beside = Path(bpy.data.filepath).parent
    for scene in bpy.data.scenes:
        name = scene.unveil.workspace
        if not name:
            continue
        recorded = blocks.absolute(name)
        moved = beside / recorded.name
        if not (recorded / "workspace.json").is_file() and (moved / "workspace.json").is_file():
            follow(scene, recorded, moved)


def follow(scene: Any, old: Path, new: Path) -> None:
    """Let all that led into the old folder lead into the new one."""
    blocks.look_up([str(new)])
    places = {str(old), scene.unveil_selection.workspace or str(old)}  # the second has no links in it
    scene.unveil.workspace = str(new)

    def now(path: str) -> str:
        """Where a file of the workspace is now; other paths as they are."""
        for place in places:
            within = _within(bpy.path.abspath(path), place) if path else None
            if within is not None:
                return str(new / within)
        return path

    listed = scene.unveil_selection
    if listed.workspace:
        listed.workspace = os.path.realpath(new)
    for thing in listed.objects:
        thing.thumbnail, thing.mattes = now(thing.thumbnail), now(thing.mattes)
    for collection in scene.collection.children_recursive:
        place = collection.get(blocks.WORKSPACE)
        if place and now(str(place)) != place:
            collection[blocks.WORKSPACE] = os.path.realpath(new)
            blocks.look_up([os.path.realpath(new)])
    for block in (*bpy.data.images, *bpy.data.movieclips):
        if block.get(blocks.DRIVE) and blocks.is_own(block) and now(block.filepath) != block.filepath:
            block.filepath = blocks.as_preferred(now(block.filepath))
    for strip in blocks.strips(scene):
        if strip.get(blocks.DRIVE) and now(strip.directory) != strip.directory:
            strip.directory = blocks.as_preferred(now(strip.directory))
    drive = _within(bpy.path.abspath(scene.unveil.drive), str(old.parent)) if scene.unveil.drive else None
    if drive is not None and (new.parent / drive).exists() and not (old.parent / drive).exists():
        scene.unveil.drive = str(new.parent / drive)  # it lay beside the workspace, and still does


def _within(path: str, folder: str) -> Path | None:
    """The path relative to a folder that it lies in, else None."""
    try:
        return Path(os.path.normpath(path)).relative_to(os.path.normpath(folder))
    except ValueError:
        return None
