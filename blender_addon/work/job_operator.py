# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators that start a job share: a blocking ``execute()`` and a modal ``invoke()`` on the same core.

Scripts and ``--background`` get the blocking one: the call returns when the job has ended, and raises where it failed.
Buttons get the modal one: a timer takes in what the job tells, Blender stays usable, Esc cancels.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import bpy

from ..formats.files import one_line
from ..scene import versions
from ..worker.job_state import JobState, duration
from ..worker.jobs import Job, unveil_job
from ..worker.session import session
from ..worker.workspace_state import STAGES
from . import logs
from .preferences import unveil_interpreter

__all__ = ["JobOperator", "UserError", "progress_lines", "stage_line"]

TICK_S = 0.1


class UserError(Exception):
    """What keeps a job from starting, in one line."""


class JobOperator:
    """Mix in before ``bpy.types.Operator``; give ``bl_label``, :meth:`arguments` and, where wanted, :meth:`finished`."""

    _timer: Any = None
    _drawn: Any = None
    _scene, workspace_used = "", ""
    """Of the job: another scene, or another workspace in it, may be looked at when it ends."""
    _modal = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if session.busy:
            cls.poll_message_set(f"{session.title} is still running")  # type: ignore[attr-defined]
        return not session.busy

    # ------------------------------------------------------------------------------------------------- what subclasses say

    def title(self) -> str:
        """Of the job, for people."""
        return str(self.bl_label)  # type: ignore[attr-defined]

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Verb and options of the ``unveil`` command, with absolute paths.

        Raises:
            UserError: it cannot be started as things stand.
        """
        raise NotImplementedError

    def start(self, context: bpy.types.Context) -> Job:
        """Start the job; the ``unveil`` command by default."""
        arguments = self.arguments(context)
        return unveil_job(_interpreter(context), arguments)

    def finished(self, context: bpy.types.Context, state: JobState) -> None:
        """It has ended well: load what it has made."""

    def ended(self, context: bpy.types.Context, state: JobState) -> None:
        """It has ended, well or not."""

    # ----------------------------------------------------------------------------------------------------------- the two ways

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self._begin(context):
            return {"CANCELLED"}
        session.wait()
        return self._conclude(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not versions.has_window():
            return self.execute(context)
        if not self._begin(context):
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK_S, window=context.window)
        manager.modal_handler_add(self)
        self._modal = True
        self._show(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not session.busy:  # ended from elsewhere: another file was opened, the add-on was switched off
            self._leave(context)
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            session.cancel()
            self._show(context)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        started = time.perf_counter()
        state = session.tick()
        self._show(context)
        session.ticks.add(time.perf_counter() - started)
        if state.running:
            return {"PASS_THROUGH"}
        self._leave(context)
        return self._conclude(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender takes the operator away, as when it opens another file."""
        self._leave(context)
        session.end()

    # -------------------------------------------------------------------------------------------------------- what both share

    def _begin(self, context: bpy.types.Context) -> bool:
        try:
            session.begin(self.title(), lambda: self.start(context))
            self._scene, self.workspace_used = context.scene.name, context.scene.unveil.workspace
        except UserError as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return False
        except (OSError, ValueError) as error:  # of the interpreter, or of what is written for the worker to read
            self.report({"ERROR"}, one_line(error, context.scene.unveil.workspace))  # type: ignore[attr-defined]
            return False
        return True

    def _conclude(self, context: bpy.types.Context) -> set[str]:
        state = session.conclude()
        self.ended(context, state)
        logs.write_log(state)
        redraw(context)
        if state.status == "done":
            scene = bpy.data.scenes.get(self._scene)
            if scene is not None:
                with context.temp_override(scene=scene):
                    self.finished(context, state)
            self.report({"INFO"}, f"{self.title()}: done")  # type: ignore[attr-defined]
            return {"FINISHED"}
        if state.status == "cancelled":
            self.report({"WARNING"}, f"{self.title()}: cancelled; start it again to go on")  # type: ignore[attr-defined]
        else:
            # An error pops up under the pointer, which is on the panel that says it in red: there a line below will do.
            self.report({"WARNING" if self._modal and _panel_in_sight(context) else "ERROR"}, state.error)  # type: ignore[attr-defined]
        return {"CANCELLED"}

    def _show(self, context: bpy.types.Context) -> None:
        state, job = session.last, session.job
        if state is None or job is None:
            return
        text = f"Unveil: {progress_text(state)}   [Esc] cancels"
        drawn = (text, round(state.fraction, 2), len(state.ended), job.cancelling)
        if drawn != self._drawn:  # drawing costs the worker's cores time where there is no graphics card
            self._drawn = drawn
            context.workspace.status_text_set(text)
            redraw(context)

    def _leave(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if context.workspace is not None:
            context.workspace.status_text_set(None)


def progress_text(state: JobState) -> str:
    """One line: stage, count, message, loss, time left."""
    return "  ".join(p for p in (stage_line(state), *progress_lines(state)) if p)


def stage_line(state: JobState) -> str:
    """The bar counts one stage: which of how many that is, and its name."""
    name = STAGES.get(state.stage, state.stage) or "starting"
    return f"Stage {state.place[0]} of {state.place[1]}: {name}" if state.place else name


def progress_lines(state: JobState) -> tuple[str, str]:
    """Count and message; loss and time left. Either may be empty."""
    count = f"{state.done}/{state.total}" if state.total > 1 else ""
    loss = f"loss {state.metrics['loss']:.4f}" if "loss" in state.metrics else ""
    left = state.seconds_left()
    remaining = f"{duration(left)} left" if left is not None else ""
    return "  ".join(p for p in (count, state.message) if p), "  ".join(p for p in (loss, remaining) if p)


def _panel_in_sight(context: bpy.types.Context) -> bool:
    """Whether one of the sidebars shows the add-on's tab."""
    areas = [a for w in context.window_manager.windows for a in w.screen.areas if a.type == "VIEW_3D"]
    sidebars = [r for a in areas if a.spaces.active.show_region_ui for r in a.regions if r.type == "UI" and r.width > 1]
    return any(getattr(r, "active_panel_category", "") == "Unveil" for r in sidebars)


def redraw(context: bpy.types.Context) -> None:
    """The sidebars, and nothing more expensive."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "PREFERENCES"):
                for region in area.regions:
                    if region.type in ("UI", "WINDOW") and (area.type, region.type) != ("VIEW_3D", "WINDOW"):
                        region.tag_redraw()


def _interpreter(context: bpy.types.Context) -> Path:
    found = unveil_interpreter(context)
    if found is None:
        raise UserError("No Python with unveil was found: open the add-on's preferences and press Create environment")
    if not found.ok:
        raise UserError(found.problem)
    return found.python
