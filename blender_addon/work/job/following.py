# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows a running job from a timer, without an operator: Blender goes on as if nothing ran, autosave and Esc included.

Results are loaded while the artist is not in the midst of something that they would disturb, each with an undo step.
"""

from __future__ import annotations

import time

import bpy

from ...worker.job_state import JobState
from ...worker.session import session
from .left_behind import keep
from .redrawing import redraw
from .task import Task
from .telling import tell_end

__all__ = ["follow", "waits_for"]

TICK_S, WAIT_S = 0.1, 0.5
"""Between two looks at the job; at the artist, where results wait to be loaded."""
BLENDERS_JOBS = ("RENDER", "OBJECT_BAKE", "COMPOSITE")
"""They read the scene in a thread of their own."""
HOLDING = ("TRANSFORM_OT", "SCULPT_OT", "PAINT_OT", "MESH_OT", "OBJECT_OT", "CURVE_OT", "CURVES_OT", "GPENCIL_OT")
"""Operators that hold on to data of the scene as long as they run. Others, as other add-ons', may run all day."""

_task: Task | None = None
_drawn: object = None
_shown: set[str] = set()


def follow(task: Task) -> None:
    """Follow the session's job to its end."""
    global _task
    _task = task
    _shown.clear()
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)  # a file may be opened


def waits_for() -> str:
    """What the artist is in the midst of, in a word or two; empty where results can be loaded."""
    if any(bpy.app.is_job_running(kind) for kind in BLENDERS_JOBS):
        return "rendering"
    for window in bpy.context.window_manager.windows:
        if any(operator.bl_idname.startswith(HOLDING) for operator in window.modal_operators):
            return "the tool in use"
        active = window.view_layer.objects.active
        if active is not None and active.mode != "OBJECT" and active.get("unveil_role"):
            return f"{active.name} to leave {active.mode.replace('_', ' ').title()} Mode"
    return ""


def _tick() -> float | None:
    """What Blender's timer calls; returns the seconds until the next call, None for no more."""
    global _task
    task = _task
    if task is None or not session.busy:  # ended from elsewhere: the add-on was switched off
        _task = None
        return None
    started = time.perf_counter()
    state = session.tick()
    _tell(state)
    session.ticks.add(time.perf_counter() - started)
    early = [stage for stage in task.shown_early if state.ended.get(stage) == "done" and stage not in _shown]
    if state.running and not early:
        return TICK_S
    session.waiting = waits_for()
    if session.waiting:
        redraw(bpy.context)
        return WAIT_S
    _shown.update(early)
    if not state.running:
        _task = None
    _load(task, state)
    return TICK_S if _task is not None else None


def _load(task: Task, state: JobState) -> None:
    """What is there so far, or at the end; from a timer Blender names no window."""
    windows = bpy.context.window_manager.windows
    with bpy.context.temp_override(window=windows[0] if windows else None):
        if state.running:
            task.show(bpy.context)  # what is wrong with it is told at the end
        else:
            task.conclude(bpy.context)
            shown = task.load is None or task.place() is not None
            if state.status == "done" and not shown:
                keep(task)
            if task.tells:
                tell_end(task.title, state, shown, task.workspace)
        redraw(bpy.context, everything=True)


def _tell(state: JobState) -> None:
    """Draw anew what has changed: drawing costs the worker's cores time where there is no graphics card."""
    global _drawn
    job = session.job
    drawn = (
        state.stage,
        state.message,
        round(state.fraction, 2),
        len(state.ended),
        job is not None and job.cancelling,
        int(state.seconds_left() or 0) // 5,
    )
    if drawn != _drawn:
        _drawn = drawn
        redraw(bpy.context)


def unregister() -> None:
    global _task
    _task = None
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
