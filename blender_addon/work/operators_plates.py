# SPDX-License-Identifier: GPL-3.0-or-later
"""Plates for compositing: exported to the workspace, and a node group a camera that plays them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty

from ..formats.drive_files import read_drive
from ..formats.plate_files import FOLDER, FORMATS, read_plates
from ..formats.timeline import timeline_of
from ..scene import blocks, cameras, drive_scene, view
from ..scene.images import compositing
from .job.job_operator import JobOperator, UserError
from .job.task import Task
from .operators_run import workspace_of

__all__: list[str] = []


class UNVEIL_OT_plates(JobOperator, bpy.types.Operator):
    """Write clean plates and a matte of each removed object at full size, with a node group that dials each object back"""

    bl_idname = "unveil.plates"
    bl_label = "Plates for Compositing"

    lens: EnumProperty(name="Lens", items=compositing.LENSES, default="DELIVERED")
    add: BoolProperty(
        name="Add to Compositor",
        description="Put the group into the scene's compositor; nothing there is linked anew",
        default=False,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        there = compositing.has_delivered(context.scene)
        if not there:
            cls.poll_message_set("There are no delivered frames yet: press Unveil, or Reload results")
        return there

    def arguments(self, context: bpy.types.Context) -> list[str]:
        scene = context.scene
        workspace = workspace_of(scene)
        if workspace is None:
            raise UserError("No results yet: import a drive, or name a results folder")
        start = str(scene.unveil.start_frame)
        formats = ",".join(FORMATS)
        return ["export", str(workspace), "--to", formats, "-o", str(workspace / FOLDER), "--start-frame", start]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=partial(_show, lens=self.lens, add=self.add))


def _show(context: bpy.types.Context, workspace: str, *, lens: str, add: bool) -> None:
    """The groups of all cameras of the scene's drive.

    Raises:
        ValueError: the plates are damaged, or the compositor is another file's; one line.
        OSError: a file cannot be read, or a copy not be made.
    """
    scene = context.scene
    collection = view.shown_drive(scene)
    if collection is None:  # deleted, or another workspace, since the job began
        return
    drive = read_drive(Path(blocks.workspace_of(collection)), drive_scene.metre_of(scene))
    timeline = timeline_of(drive, scene.unveil.start_frame)
    for track, made in read_plates(drive).items():
        group = compositing.set_group(blocks.drive_of(collection), track, drive, timeline, made, lens)
        if add:
            compositing.add_to_compositor(scene, group)


class UNVEIL_OT_add_to_compositor(bpy.types.Operator):
    """Put the node group of the plates into the scene's compositor, beside what is there; nothing is linked anew"""

    bl_idname = "unveil.add_to_compositor"
    bl_label = "Add to Compositor"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        there = _group(context.scene) is not None
        if not there:
            cls.poll_message_set("There are no plates yet: make Plates for compositing first")
        return there

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            compositing.add_to_compositor(context.scene, _group(context.scene))
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def _group(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """Of the scene's camera, or of the first camera of its drive that has one."""
    tracks = compositing.tracks_of(scene)
    tracks.sort(key=lambda camera: camera != scene.camera)
    found = (compositing.group_of(scene, str(cameras.track_of(camera))) for camera in tracks)
    return next((group for group in found if group is not None), None)


CLASSES = (UNVEIL_OT_plates, UNVEIL_OT_add_to_compositor)
