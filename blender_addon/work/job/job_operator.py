# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators that start a job share: a blocking ``execute()`` and an ``invoke()`` that returns at once.

Scripts and ``--background`` get the blocking one: the call returns when the job has ended, and raises where it failed.
Buttons get the other: a timer follows the job (see :mod:`following`), and Blender stays free for whatever the artist does.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import bpy

from ...formats.files import one_line
from ...scene import versions
from ...worker.awaited_job import AwaitedJob, Start
from ...worker.interpreter import Found
from ...worker.jobs import Job, unveil_job
from ...worker.session import session
from ..preferences import known_interpreter, search
from .following import follow
from .redrawing import redraw
from .task import Task

__all__ = ["JobOperator", "UserError"]


NO_PYTHON = "No Python with unveil was found: open the add-on's preferences and press Install"


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

    def prepare(self, context: bpy.types.Context) -> Callable[[], Start]:
        """What finds out how the job is started; called in a thread, so it asks Blender for nothing.

        Raises:
            UserError: it cannot be started as things stand.
        """
        arguments = self.arguments(context)
        known, look = known_interpreter(context), search(context)

        def found() -> Start:
            return partial(unveil_job, _usable(known or look()), arguments)

        return found

    def task(self, context: bpy.types.Context) -> Task:
        """What is done with what the job makes; asked for once it has started."""
        settings = context.scene.unveil
        return Task(self.title(), context.scene.name, settings.workspace, drive=settings.drive)

    # ----------------------------------------------------------------------------------------------------------- the two ways

    def execute(self, context: bpy.types.Context) -> set[str]:
        task = self._begin(context, lambda prepare: prepare()(None))
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
        named = context.scene.unveil.drive, context.scene.unveil.workspace
        task = self._begin(context, lambda prepare: AwaitedJob(prepare, "Looking for the Python of Unveil"))
        if task is None:
            return {"CANCELLED"}
        if (task.drive, task.workspace) != named:  # to be taken back by itself, and not with what was done before
            bpy.ops.ed.undo_push(message=self.title())
        follow(task)
        redraw(context)
        return {"FINISHED"}

    def _begin(
        self, context: bpy.types.Context, start: Callable[[Callable[[], Start]], Job | AwaitedJob]
    ) -> Task | None:
        try:
            session.begin(self.title(), lambda: start(self.prepare(context)))
        except (UserError, LookupError) as error:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
            return None
        except (OSError, ValueError) as error:  # of the interpreter, or of what is written for the worker to read
            self.report({"ERROR"}, one_line(error, context.scene.unveil.workspace))  # type: ignore[attr-defined]
            return None
        return self.task(context)


def _usable(found: Found | None) -> Path:
    """The interpreter. LookupError: it does not do."""
    if found is None:
        raise LookupError(NO_PYTHON)
    if not found.ok:
        raise LookupError(found.problem)
    return found.python
