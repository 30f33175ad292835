# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators that start a job share: a blocking ``execute()`` and an ``invoke()`` that returns at once.

Scripts and ``--background`` get the blocking one: the call returns when the job has ended, and raises where it failed.
Buttons get the other: a timer follows the job (see :mod:`following`), and Blender stays free for whatever the artist does.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ...formats.files import one_line
from ...scene import versions
from ...worker.job_state import JobState, duration
from ...worker.jobs import Job, unveil_job
from ...worker.session import session
from ...worker.workspace_state import STAGES
from ..preferences import unveil_interpreter
from .following import follow
from .redrawing import redraw
from .task import Task

__all__ = ["JobOperator", "UserError", "progress_lines", "stage_line"]


class UserError(Exception):
    """What keeps a job from starting, in one line."""


class JobOperator:
    """Mix in before ``bpy.types.Operator``; give ``bl_label``, :meth:`arguments` and, where wanted, :meth:`task`."""

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

    def task(self, context: bpy.types.Context) -> Task:
        """What is done with what the job makes; asked for once it has started."""
        return Task(self.title(), context.scene.name, context.scene.unveil.workspace)

    # ----------------------------------------------------------------------------------------------------------- the two ways

    def execute(self, context: bpy.types.Context) -> set[str]:
        task = self._begin(context)
        if task is None:
            return {"CANCELLED"}
        session.wait()
        state = task.conclude(context)
        redraw(context)
        if state.status == "done":
            self.report({"INFO"}, f"{self.title()}: done")  # type: ignore[attr-defined]
            return {"FINISHED"}
        if state.status == "cancelled":
            self.report({"WARNING"}, f"{self.title()}: cancelled; start it again to go on")  # type: ignore[attr-defined]
        else:
            self.report({"ERROR"}, state.error)  # type: ignore[attr-defined]
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not versions.has_window():
            return self.execute(context)
        return self.start_following(context)

    def start_following(self, context: bpy.types.Context) -> set[str]:
        """Start the job and return at once."""
        task = self._begin(context)
        if task is None:
            return {"CANCELLED"}
        follow(task)
        redraw(context)
        return {"FINISHED"}

    def _begin(self, context: bpy.types.Context) -> Task | None:
        try:
            session.begin(self.title(), lambda: self.start(context))
        except UserError as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return None
        except (OSError, ValueError) as error:  # of the interpreter, or of what is written for the worker to read
            self.report({"ERROR"}, one_line(error, context.scene.unveil.workspace))  # type: ignore[attr-defined]
            return None
        return self.task(context)


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


def _interpreter(context: bpy.types.Context) -> Path:
    found = unveil_interpreter(context)
    if found is None:
        raise UserError("No Python with unveil was found: open the add-on's preferences and press Install")
    if not found.ok:
        raise UserError(found.problem)
    return found.python
