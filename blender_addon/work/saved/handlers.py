# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens when files are opened and saved: the work of the file before ends, paths are made to fit, moved workspaces found."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent

from ...worker.session import session
from .moved_workspace import find_moved_workspaces
from .paths_in_file import look_up_all, make_absolute, make_relative

__all__: list[str] = []


@persistent
def _before_load(*_: object) -> None:
    session.end()
    session.last = None  # it spoke of the other file


@persistent
def _after_load(*_: object) -> None:
    make_absolute()
    find_moved_workspaces()
    look_up_all()


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
    if bpy.app.timers.is_registered(_switched_on):
        bpy.app.timers.unregister(_switched_on)
    for name, handler in HANDLERS.items():
        if handler in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
