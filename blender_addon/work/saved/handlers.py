# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens when files are opened and saved: work goes on and is taken up, paths are made to fit, moved workspaces found."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent

from ...scene import versions
from ...worker.session import session
from ..job.left_behind import take_up
from ..job.telling import tell
from .moved_workspace import find_moved_workspaces
from .paths_in_file import look_up_all, make_absolute, make_relative

__all__: list[str] = []

SOON_S = 0.05


@persistent
def _before_load(*_: object) -> None:
    """A job goes on: what it makes lies in its workspace, and is loaded where a scene has that. See :class:`Task`."""
    session.file += 1
    if not session.busy:
        session.last = None  # it spoke of the other file


@persistent
def _after_load(*_: object) -> None:
    make_absolute()
    find_moved_workspaces()
    look_up_all()
    if versions.has_window():
        bpy.app.timers.register(_take_up, first_interval=SOON_S)  # once Blender is done with opening the file
    else:
        _take_up()


def _take_up() -> None:
    for line in take_up(bpy.context):
        tell(line)


@persistent
def _before_save(blend: object = "", *_: object) -> None:
    make_relative(blend if isinstance(blend, str) else bpy.data.filepath)


@persistent
def _after_save(blend: object = "", *_: object) -> None:
    make_absolute(blend if isinstance(blend, str) else "")


def _switched_on() -> None:
    """A file may be open already; while an add-on is registered, Blender gives nothing of it."""
    _after_load()


HANDLERS: dict[str, Callable[..., None]] = {
    "load_pre": _before_load,
    "load_post": _after_load,
    "save_pre": _before_save,
    "save_post": _after_save,
    "save_post_fail": _after_save,
}


def register() -> None:
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    bpy.app.timers.register(_switched_on, first_interval=0.1)


def unregister() -> None:
    for timer in (_switched_on, _take_up):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    for name, handler in HANDLERS.items():
        if handler in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
