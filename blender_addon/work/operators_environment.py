# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the Python that has unveil, or make one."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Any

import bpy

from ..scene import versions
from ..worker import environment
from ..worker.interpreter import Candidate, Found, check
from ..worker.job_state import JobState
from ..worker.jobs import Job
from .job_operator import JobOperator, UserError, redraw
from .preferences import environment_folder, forget, preferences, remember, unveil_interpreter

__all__ = ["UNVEIL_OT_check_python", "UNVEIL_OT_create_environment"]


class Thorough(threading.Thread):
    """Has a Python examined; what was found is there when it has ended."""

    def __init__(self, quick: Found) -> None:
        super().__init__(name="unveil-check", daemon=True)
        self.quick = quick
        self.found: Found | None = None
        self.start()

    def run(self) -> None:
        self.found = check(Candidate(self.quick.python, self.quick.source))


class UNVEIL_OT_check_python(bpy.types.Operator):
    """Look for the Python that has unveil and see what it can do; takes some seconds"""

    bl_idname = "unveil.check_python"
    bl_label = "Check"

    _timer: Any = None
    _looking: Thorough | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return UNVEIL_OT_check_python._looking is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        forget()
        return self._tell(context, unveil_interpreter(context, full=True))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Where the Python is takes no time; what it can do takes half a minute the first time, and Blender stays usable."""
        forget()
        found = unveil_interpreter(context)
        if found is None or not found.ok:
            return self._tell(context, found)
        if not versions.has_window():
            return self.execute(context)
        UNVEIL_OT_check_python._looking = Thorough(found)
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        looking = UNVEIL_OT_check_python._looking
        if event.type != "TIMER" or (looking is not None and looking.is_alive()):
            return {"PASS_THROUGH"}
        self.cancel(context)
        if looking is not None and looking.found is not None:
            remember(context, looking.found)
        return self._tell(context, looking and looking.found)

    def cancel(self, context: bpy.types.Context) -> None:
        UNVEIL_OT_check_python._looking = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None

    def _tell(self, context: bpy.types.Context, found: Found | None) -> set[str]:
        redraw(context)
        if found is None:
            chosen = preferences(context)
            named = chosen.python if chosen else ""
            problem = f"{named}: there is no such Python" if named else "No Python was found: press Create environment"
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        if not found.ok:
            self.report({"ERROR"}, found.problem)
            return {"CANCELLED"}
        self.report({"INFO"}, "  ".join(found.lines()))
        return {"FINISHED"}


class UNVEIL_OT_create_environment(JobOperator, bpy.types.Operator):
    """Make a Python environment in the extension's user folder and install unveil into it (some hundred megabytes)"""

    bl_idname = "unveil.create_environment"
    bl_label = "Create environment"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not bpy.app.online_access:
            cls.poll_message_set("Needs online access: Preferences > System > Network")
            return False
        return super().poll(context)

    def start(self, context: bpy.types.Context) -> Job:
        folder = environment_folder(create=True)
        if folder is None:
            raise UserError(
                "Unveil is not installed as an extension: install its zip, or name a Python in its preferences"
            )
        base = environment.base_python(sys.executable)
        if base is None:
            raise UserError("No Python 3.11, 3.12 or 3.13 that can make an environment was found: install one first")
        chosen = preferences(context)
        try:
            wanted = environment.requirement(chosen.install_from)
        except LookupError as error:
            raise UserError(str(error)) from error
        command = [base, "-I", "-u", str(Path(environment.__file__)), str(folder), wanted]
        locked = environment.locks()
        command += ["--locks", str(locked)] if locked is not None else []
        return Job([*command, "--torch-index", chosen.torch_index])

    def ended(self, context: bpy.types.Context, state: JobState) -> None:
        folder = environment_folder()
        if folder is not None:
            environment.remove_unfinished(folder)
        forget()

    def finished(self, context: bpy.types.Context, state: JobState) -> None:
        chosen = preferences(context)
        if chosen is not None:
            chosen.python = ""  # one that is named there would hide the new one
        unveil_interpreter(context)


CLASSES = (UNVEIL_OT_check_python, UNVEIL_OT_create_environment)
