# SPDX-License-Identifier: GPL-3.0-or-later
"""The next step with what a job tells, and the section Unveil: settings, and each stage with its state."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import bpy

from ..formats.table.run_settings import ADVANCED, BASIC, SUN, RunSetting
from ..scene.drive_scene import tracks_of
from ..scene.view import shown_drive
from ..work.stage_states import stage_states
from ..worker.job_state import duration
from ..worker.session import session
from ..worker.workspace_state import STAGES, StageState
from .next_step import next_step
from .panels import Section
from .telling import progress

__all__ = ["UNVEIL_PT_reading", "UNVEIL_PT_run", "UNVEIL_PT_stages", "UNVEIL_PT_work"]

READING = ("read", "place")
"""Groups of settings of the import."""
SAID = {"stale": "out of date"}
MOST_LINES = 6
"""Of an error: a longer one would push everything else out of sight."""
SHORT = {
    "movers": "Moving",
    "scale": "Units/Metre",
    "camera_height": "Camera Up (m)",
    "reference_inpainter": "By Reference",
    "pose_convention": "Poses As",
    "instance_maps": "Instances",
    "label_classes": "Label Set",
    "model": "COLMAP",
}
"""Names that the sidebar has room for, where those of the settings are too long for it."""
ICONS = {"to do": "RADIOBUT_OFF", "running": "PLAY", "done": "CHECKMARK", "stale": "FILE_REFRESH", "failed": "ERROR"}


class UNVEIL_PT_work(Section, bpy.types.Panel):
    """How it stands, the next step, and what a job tells: above everything else, so that it is always in sight."""

    bl_idname = "UNVEIL_PT_work"
    bl_label = "Unveil"
    bl_order = 0
    bl_options = {"HIDE_HEADER"}

    def draw(self, context: bpy.types.Context) -> None:
        if session.busy:
            self._progress(context)
        else:
            step = next_step(context)
            self.layout.label(text=step.said, icon=step.icon)
            row = self.layout.row()
            row.scale_y = 1.6
            button = row.operator(step.operator, text=step.text, icon=step.sign)
            for name, value in step.options.items():
                setattr(button, name, value)
            if step.operator == "unveil.open_drive":  # who has cameras already; others have a clip alone
                self.layout.operator("unveil.import_footage", text="Import Footage…", icon="FILE_MOVIE")
            if step.operator == "unveil.run" and shown_drive(context.scene) is not None:
                row = self.layout.row(align=True)
                row.operator("unveil.preview", icon="HIDE_OFF")
                row.operator("unveil.what_goes", text="What Goes", icon="PRESET")
        if _has_results(context):
            row = self.layout.row(align=True)
            row.scale_y = 1.2
            row.prop(context.scene.unveil_view, "state", expand=True)
            collection = shown_drive(context.scene)
            if collection is not None and context.scene.camera not in tracks_of(collection):
                # An own camera shows its own plate, neither photographs nor clean frames.
                text = "Look Through the Drive's Camera"
                self.layout.operator("unveil.look_through", text=text, icon="CAMERA_DATA").track = ""
        self._outcome(context)

    def _progress(self, context: bpy.types.Context) -> None:
        state, job = session.last, session.job
        if state is None or job is None:
            return
        box = self.layout.box()
        box.label(text=progress.job_said(state))
        part = progress.whole(state, session.age_s)
        left = progress.time_left(state)
        box.progress(factor=part, text=f"{100 * part:.0f} %" + (f", {left}" if left else ""))
        if session.waiting:
            box.label(text=f"Results wait for {session.waiting}", icon="INFO")
        row = box.row()
        row.enabled = not job.cancelling and state.running
        row.operator("unveil.cancel", text="Cancelling…" if job.cancelling else "Cancel", icon="CANCEL")

    def _outcome(self, context: bpy.types.Context) -> None:
        state = session.last
        if state is not None and not state.running and state.error:
            box = self.layout.box()
            box.alert = True
            column = box.column(align=True)
            lines = _wrapped(context, state.error)
            if len(lines) > MOST_LINES:
                lines = [*lines[: MOST_LINES - 1], "… the log tells the rest"]
            for i, line in enumerate(lines):
                column.label(text=line, icon="ERROR" if i == 0 else "BLANK1")
        elif state is not None and state.status == "cancelled":
            self.layout.label(text="Cancelled; start again to go on", icon="INFO")
        if state is not None and not session.busy and state.error:
            self.layout.operator("unveil.show_log", icon="TEXT")


class UNVEIL_PT_run(Section, bpy.types.Panel):
    """Settings and work."""

    bl_idname = "UNVEIL_PT_run"
    bl_label = "Unveil"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        scene = context.scene
        settings = scene.unveil
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.enabled = not session.busy
        column.prop(settings, "results_folder")
        _settings(column, settings, [s for s in BASIC if s.group not in READING])
        more = column.row()
        more.use_property_split = False
        more.prop(settings, "show_more", toggle=True, icon="PREFERENCES")
        if settings.show_more:
            column.prop(settings, "preview_frames")
            _settings(column, settings, ADVANCED)
        if not session.busy and next_step(context).operator != "unveil.run":  # which has it above
            row = layout.row(align=True)
            row.enabled = bool(settings.drive)
            row.operator("unveil.run", icon="PLAY")
            row.operator("unveil.preview", icon="HIDE_OFF")
        found = stage_states(scene)
        if found is not None and found.problem:
            layout.label(text=found.problem, icon="INFO")
        if found is not None and not found.exists and shown_drive(scene) is not None:
            layout.operator("unveil.find_workspace", icon="VIEWZOOM")


class UNVEIL_PT_reading(Section, bpy.types.Panel):
    """What of the drive is read, and how large the world is: settings of the import."""

    bl_idname = "UNVEIL_PT_reading"
    bl_label = "Reading the Drive"
    bl_parent_id = "UNVEIL_PT_run"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.enabled = not session.busy
        _settings(column, context.scene.unveil, [s for s in BASIC if s.group in READING])


class UNVEIL_PT_stages(Section, bpy.types.Panel):
    """Each stage with its state, for those who want to run one alone."""

    bl_idname = "UNVEIL_PT_stages"
    bl_label = "Stages"
    bl_parent_id = "UNVEIL_PT_run"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        found = stage_states(context.scene)
        if found is None or not found.exists:
            return
        column = self.layout.column(align=True)
        for name, stage in found.stages.items():
            self._stage(column, name, _live(stage))
        for stage in found.stages.values():
            if stage.message and not (session.last is not None and session.last.error):
                for line in _wrapped(context, f"{STAGES[stage.name]}: {stage.message}"):
                    self.layout.label(text=line)

    def _stage(self, layout: Any, name: str, stage: StageState) -> None:
        row = layout.row(align=True)
        status = duration(stage.seconds) if stage.seconds is not None else SAID.get(stage.state, stage.state)
        columns = row.split(factor=0.62)
        columns.label(text=STAGES[name], icon=ICONS[stage.state])
        columns.label(text=status)
        button = row.row(align=True)
        button.enabled = not session.busy
        button.operator("unveil.stage", text="", icon="PLAY").stage = name


def _settings(column: bpy.types.UILayout, settings: Any, shown: Sequence[RunSetting]) -> None:
    """A row for each; the sun below the shadows where it is given."""
    for setting in shown:
        column.prop(settings, setting.name, text=SHORT.get(setting.name, setting.label))
        if setting.shape == "sun" and settings.shadows == "given":
            for name in SUN:
                column.prop(settings, name)


def _has_results(context: bpy.types.Context) -> bool:
    collection = shown_drive(context.scene)
    return collection is not None and bool(collection.get("unveil_clean") or collection.get("unveil_results"))


def _live(stage: StageState) -> StageState:
    """With what the running job has reported of it."""
    state = session.last if session.busy else None
    if state is None:
        return stage
    if stage.name in state.ended:
        ended = state.ended[stage.name]
        return StageState(stage.name, "failed" if ended == "failed" else "done", stage.seconds)
    return StageState(stage.name, "running") if stage.name == state.stage else stage


def _wrapped(context: bpy.types.Context, text: str) -> list[str]:
    """Lines that fit into the sidebar: labels do not wrap by themselves."""
    width = (context.region.width if context.region is not None else 0) or 300
    characters = max(int(width / (7.5 * (context.preferences.system.ui_scale or 1.0))) - 4, 16)
    return textwrap.wrap(text, characters, break_on_hyphens=False) or [""]


CLASSES = (UNVEIL_PT_work, UNVEIL_PT_run, UNVEIL_PT_reading, UNVEIL_PT_stages)
