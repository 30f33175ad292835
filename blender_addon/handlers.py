# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening another file ends the work of the one before, and finds the workspace of a file that was moved with it."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from .session import session

__all__ = ["find_moved_workspaces"]


@persistent
def _before_load(*_: object) -> None:
    session.end()
    session.last = None  # it spoke of the other file


@persistent
def _after_load(*_: object) -> None:
    find_moved_workspaces()


def find_moved_workspaces() -> None:
    """Where a scene's workspace is gone and one of its name lies beside the .blend: take that."""
    if not bpy.data.filepath:
        return
    beside = Path(bpy.data.filepath).parent
    for scene in bpy.data.scenes:
        name = scene.unveil.workspace
        if not name:
            continue
        recorded = Path(bpy.path.abspath(name))
        moved = beside / recorded.name
        if not (recorded / "workspace.json").is_file() and (moved / "workspace.json").is_file():
            scene.unveil.workspace = str(moved)


def register() -> None:
    bpy.app.handlers.load_pre.append(_before_load)
    bpy.app.handlers.load_post.append(_after_load)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(_after_load)
    bpy.app.handlers.load_pre.remove(_before_load)
