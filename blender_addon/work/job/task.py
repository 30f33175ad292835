# SPDX-License-Identifier: GPL-3.0-or-later
"""What a job is for: the scene and workspace that it was started for, and what is done with what it makes.

Names rather than data blocks, for an undo step or another file may come between its start and its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy

from ...formats.files import one_line
from ...scene import blocks
from ...worker.job_state import JobState
from ...worker.session import session
from . import logs

__all__ = ["Task"]


@dataclass(frozen=True)
class Task:
    """Attributes:
    title: for people.
    scene: name of the scene that asked for it; another may be looked at when it ends.
    workspace: that it works on, as the scene named it.
    load: brings the workspace's results into a scene; None where the job makes none.
    ended: called at the end, however that came; None for nothing.
    shown_early: stages whose results are loaded as soon as they are there.
    """

    title: str
    scene: str
    workspace: str
    load: Callable[[bpy.types.Context, str], object] | None = None
    ended: Callable[[bpy.types.Context, JobState], None] | None = None
    shown_early: tuple[str, ...] = ()

    def conclude(self, context: bpy.types.Context) -> JobState:
        """The job has ended: its log, and what it has made. A result that cannot be loaded is an error of the job."""
        state = session.conclude()
        if self.ended is not None:
            self.ended(context, state)
        if state.status == "done":
            problem = self.show(context)
            if problem:
                state.status, state.error = "failed", problem
                state.note(problem)
        logs.write_log(state)
        return state

    def show(self, context: bpy.types.Context) -> str:
        """Load what is there so far. Returns one line on what is wrong with it, or an empty string."""
        scene = bpy.data.scenes.get(self.scene)
        if self.load is None or scene is None:
            return ""
        try:
            with context.temp_override(scene=scene):
                self.load(context, self.workspace)
            # It can be taken back, and does not go with what the artist did before.
            bpy.ops.ed.undo_push(message=f"{self.title}: results")
        except (OSError, ValueError) as error:
            return one_line(error, blocks.absolute(self.workspace))
        return ""
