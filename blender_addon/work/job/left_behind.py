# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that ended while another file was open: its results are loaded when a file is opened that has a place for them."""

from __future__ import annotations

import bpy

from .task import Task

__all__ = ["keep", "take_up"]

_kept: list[Task] = []


def keep(task: Task) -> None:
    """Remember it as long as Blender runs; the latest of a workspace alone."""
    _kept[:] = [other for other in _kept if other.workspace != task.workspace]
    _kept.append(task)


def take_up(context: bpy.types.Context) -> list[str]:
    """Load what the open file has a place for. Returns a line for each: what was loaded, or what is wrong with it."""
    said = []
    for task in [task for task in _kept if task.place() is not None]:
        _kept.remove(task)
        problem = task.show(context)
        said.append(problem or f"{task.title}: its results were loaded")
    return said
