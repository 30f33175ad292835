# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of the add-on's own properties: absolute while a file is open, relative in the file where Blender's preference says so.

Blender does that for pictures and strips; of an add-on's properties it knows nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy

from ...scene import blocks

__all__ = ["look_up_all", "make_absolute", "make_relative"]


def make_relative(blend: str) -> None:
    """For the file that is about to be written."""
    if not blend or not bpy.context.preferences.filepaths.use_relative_paths:
        return
    start = str(Path(blend).parent)

    def relative(path: str) -> str:
        try:
            return str(bpy.path.relpath(bpy.path.abspath(path), start=start))
        except ValueError:  # on another drive
            return path

    _change(relative)


def make_absolute(blend: str = "") -> None:
    """As long as the file is open.

    Args:
        blend: that relative paths start from; the open file by default.
    """
    start = str(Path(blend).parent) if blend else None
    _change(lambda path: os.path.abspath(bpy.path.abspath(path, start=start)) if path.startswith("//") else path)


def look_up_all() -> None:
    """Find out where all workspaces lead: drawing does not."""
    paths = [path for scene in _scenes() for path in (scene.unveil.workspace, scene.unveil_selection.workspace)]
    blocks.look_up([*paths, *(str(c.get(blocks.WORKSPACE, "")) for c in bpy.data.collections)])


def _scenes() -> list[bpy.types.Scene]:
    return [scene for scene in bpy.data.scenes if blocks.is_own(scene)]


def _change(changed: Callable[[str], str]) -> None:
    for owner, name in _paths():
        path = str(owner[name] if isinstance(owner, bpy.types.Collection) else getattr(owner, name))
        if path and changed(path) != path:
            if isinstance(owner, bpy.types.Collection):
                owner[name] = changed(path)
            else:
                setattr(owner, name, changed(path))


def _paths() -> Iterator[tuple[Any, str]]:
    """Owner and name of each property that holds a path."""
    for scene in _scenes():
        yield from ((scene.unveil, name) for name in ("drive", "workspace"))
        yield scene.unveil_selection, "workspace"
        for thing in scene.unveil_selection.objects:
            yield from ((thing, name) for name in ("thumbnail", "mattes"))
    for collection in bpy.data.collections:
        if collection.get(blocks.WORKSPACE) and blocks.is_own(collection):
            yield collection, blocks.WORKSPACE
