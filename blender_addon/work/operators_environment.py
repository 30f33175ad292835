# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the Python that has unveil, or make one."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy

from ..scene import versions
from ..worker import base_python, environment
from ..worker.awaited_job import Start
from ..worker.interpreter import Candidate, Found, check, lies_beside_files
from ..worker.job_state import JobState
from ..worker.jobs import Job
from .job.job_operator import JobOperator, UserError
from .job.redrawing import redraw
from .job.task import Task
from .job.telling import tell
from .preferences import (
    OFFLINE,
    environment_folder,
    forget,
    may_install,
    preferences,
    remember,
    search,
    unveil_interpreter,
    work_folder,
)

__all__ = ["UNVEIL_OT_check_python", "UNVEIL_OT_create_environment"]


LOOK_S = 0.1


class Thorough(threading.Thread):
    """Has the Python looked for and examined; what was found is there when it has ended."""

    def __init__(self, look: Callable[[], Found | None], work: Path) -> None:
        super().__init__(name="unveil-check", daemon=True)
        self.look, self.work = look, work
        self.found: Found | None = None
        self.start()

    def run(self) -> None:
        quick = self.look()
        if quick is not None and quick.ok:
            quick = check(Candidate(quick.python, quick.source), work=self.work)
        self.found = quick


class UNVEIL_OT_check_python(bpy.types.Operator):
    """Look for the Python that has unveil; tell its versions, this machine, and what to do about what is wrong"""

    bl_idname = "unveil.check_python"
    bl_label = "Check Python"

    _looking: Thorough | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return UNVEIL_OT_check_python._looking is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        forget()
        return self._tell(context, unveil_interpreter(context, full=True))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """What it can do takes half a minute the first time, and one that hangs longer: Blender stays usable."""
        if not versions.has_window():
            return self.execute(context)
        forget()
        UNVEIL_OT_check_python._looking = Thorough(search(context), work_folder(context))
        bpy.app.timers.register(_examined, first_interval=LOOK_S, persistent=True)  # also where a file is opened
        redraw(context)
        return {"FINISHED"}

    def _tell(self, context: bpy.types.Context, found: Found | None) -> set[str]:
        redraw(context)
        problem = _problem(context, found)
        if problem:
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        assert found is not None
        self.report({"INFO"}, "  ".join(found.lines()))
        return {"FINISHED"}


def _problem(context: bpy.types.Context, found: Found | None) -> str:
    """What is wrong with what was found, in one line; empty for nothing."""
    if found is not None:
        return found.problem
    chosen = preferences(context)
    named = chosen.python if chosen else ""
    if lies_beside_files(named):
        return f"{named}: leads to another place with each file: name the whole path of a Python"
    return f"{named}: Not a Python" if named else "No Python was found: press Install"


def _examined() -> float | None:
    """What Blender's timer calls until the Python was examined; the preferences tell what was found."""
    looking = UNVEIL_OT_check_python._looking
    if looking is not None and looking.is_alive():
        return LOOK_S
    UNVEIL_OT_check_python._looking = None
    if looking is not None:
        if looking.found is not None:
            remember(bpy.context, looking.found)
        if problem := _problem(bpy.context, looking.found):
            tell(problem, "ERROR")
    redraw(bpy.context)
    return None


class UNVEIL_OT_create_environment(JobOperator, bpy.types.Operator):
    """Make a Python environment in the extension's user folder and install unveil into it (2 GB of disk, more with CUDA)"""

    bl_idname = "unveil.create_environment"
    bl_label = "Install"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not may_install(preferences(context)):
            cls.poll_message_set(f"To install, {OFFLINE}")
            return False
        return super().poll(context)

    def prepare(self, context: bpy.types.Context) -> Callable[[], Start]:
        folder = environment_folder(create=True)
        if folder is None:
            raise UserError(
                "Unveil is not installed as an extension: install its zip, or name a Python in its preferences"
            )
        chosen = preferences(context)
        try:
            wanted = environment.requirement(chosen.install_from)
            wheels = environment.wheels_folder(chosen.wheels, wanted)
        except LookupError as error:
            raise UserError(str(error)) from error
        minors = (environment.minors_of(wheels) if wheels else ()) or base_python.MINORS
        index, blenders = str(chosen.torch_index), bpy.utils.resource_path("LOCAL")
        locked = environment.locks()

        def found() -> Start:
            base = base_python.base_python(sys.executable, minors=minors)
            if base is None:
                wanted_versions = " or ".join(f"3.{minor}" for minor in sorted(minors))
                raise LookupError(
                    f"No Python {wanted_versions} that can make an environment was found: install one first"
                )
            command = [base, "-I", "-u", str(Path(environment.__file__)), str(folder), wanted]
            command += ["--locks", str(locked)] if locked is not None else []
            command += ["--wheels", str(wheels)] if wheels is not None else []
            command += ["--copy-base"] if base_python.lies_in(base, blenders) else []
            command += ["--torch-index", index]
            return lambda state: Job(command, state=state)

        return found

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), ended=_environment_made)


def _environment_made(context: bpy.types.Context, state: JobState) -> None:
    folder = environment_folder()
    if folder is not None:
        environment.remove_unfinished(folder)
    forget()
    if state.status != "done":
        return
    chosen = preferences(context)
    if chosen is not None:
        chosen.python = ""  # one that is named there would hide the new one
    if versions.has_window():
        threading.Thread(target=search(context), name="unveil-search", daemon=True).start()
    else:
        unveil_interpreter(context)


CLASSES = (UNVEIL_OT_check_python, UNVEIL_OT_create_environment)


def unregister() -> None:
    UNVEIL_OT_check_python._looking = None
    if bpy.app.timers.is_registered(_examined):
        bpy.app.timers.unregister(_examined)
