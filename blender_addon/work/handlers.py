# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening another file ends the work of the one before, and finds the workspace of a file that was moved with it."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..worker.session import session
from .moved_workspace import find_moved_workspaces

__all__: list[str] = []


@persistent
def _before_load(*_: object) -> None:
    session.end()
    session.last = None  # it spoke of the other file


@persistent
def _after_load(*_: object) -> None:
    find_moved_workspaces()


def register() -> None:
    bpy.app.handlers.load_pre.append(_before_load)
    bpy.app.handlers.load_post.append(_after_load)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(_after_load)
    bpy.app.handlers.load_pre.remove(_before_load)
