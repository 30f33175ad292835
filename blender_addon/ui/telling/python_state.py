# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether there is a Python that has unveil: looked for once, by a thread, so that panels can say so before anything is pressed."""

from __future__ import annotations

import threading

import bpy

from ...scene import versions
from ...work import preferences
from ...work.job.redrawing import redraw

__all__ = ["is_looking", "is_missing"]

FIRST_S, LOOK_S = 1.0, 0.2


class _Looking(threading.Thread):
    """The preferences remember what it has found when it has ended."""

    def __init__(self, context: bpy.types.Context) -> None:
        super().__init__(name="unveil-look", daemon=True)
        self.named = _named(context)
        self._search = preferences.search(context)
        self.start()

    def run(self) -> None:
        self._search()


_looking: _Looking | None = None
_looked_for: str | None = None
"""What the preferences named when it was looked for; None before."""


def _named(context: bpy.types.Context) -> str:
    chosen = preferences.preferences(context)
    return chosen.python if chosen else ""


def is_looking() -> bool:
    """Whether the thread is at it."""
    return _looking is not None and _looking.is_alive()


def is_missing(context: bpy.types.Context) -> bool:
    """Whether it is known that there is none, or none that does. Touches no disk."""
    found = preferences.known(preferences.preferences(context))
    if found is not None:
        return not found.ok
    return _looked_for == _named(context) and not is_looking()


def _look() -> float | None:
    """What Blender's timer calls: starts the thread, then waits for it."""
    global _looking, _looked_for
    if _looking is None:
        _looking = _Looking(bpy.context)
        return LOOK_S
    if _looking.is_alive():
        return LOOK_S
    if _looking.named != _named(bpy.context):  # another was named meanwhile
        _looking = None
        return LOOK_S
    _looked_for = _looking.named
    redraw(bpy.context)
    return None


def register() -> None:
    if versions.has_window():
        bpy.app.timers.register(_look, first_interval=FIRST_S, persistent=True)


def unregister() -> None:
    global _looking, _looked_for
    _looking = _looked_for = None
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
