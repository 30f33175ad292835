# SPDX-License-Identifier: GPL-3.0-or-later
"""What a job is for: the scene and workspace that it was started for, and what is done with what it makes.

Names rather than data blocks, for an undo step or another file may come between its start and its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

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
    drive: that the scene named.
    names: whether drive and workspace were named by what started the job, as by an import: an undo step takes back these names too.
    tells: whether its end is reported; not where ``ended`` does so.
    file: the file that was open, as the session counts them.
    """

    title: str
    scene: str
    workspace: str
    load: Callable[[bpy.types.Context, str], object] | None = None
    ended: Callable[[bpy.types.Context, JobState], None] | None = None
    shown_early: tuple[str, ...] = ()
    drive: str = ""
    names: bool = False
    tells: bool = True
    file: int = field(default_factory=lambda: session.file)

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
        if self.load is None or self.place() is not None:  # the log of a job of another file is not this file's
            logs.write_log(state)
        return state

    def show(self, context: bpy.types.Context) -> str:
        """Load what is there so far, where there is a scene for it. Returns one line on what is wrong, or an empty string."""
        scene = self.place()
        if self.load is None or scene is None:
            return ""
        try:
            if self.names or not scene.unveil.workspace:  # an undo step has taken them back
                scene.unveil.drive, scene.unveil.workspace = self.drive, self.workspace
            with context.temp_override(scene=scene):
                self.load(context, self.workspace)
            # It can be taken back, and does not go with what the artist did before.
            bpy.ops.ed.undo_push(message=f"{self.title}: results")
        except (OSError, ValueError, RuntimeError) as error:  # the last of Blender's own
            return one_line(error, blocks.absolute(self.workspace))
        return ""

    def place(self) -> bpy.types.Scene | None:
        """The scene that asked for it; where another file was opened or it has another name, one with the same workspace."""
        scene = bpy.data.scenes.get(self.scene)
        if session.file == self.file and scene is not None:
            return scene
        if not self.workspace:
            return None
        named = (s for s in bpy.data.scenes if s.unveil.workspace)
        return next((s for s in named if blocks.same_place(s.unveil.workspace, self.workspace)), None)
