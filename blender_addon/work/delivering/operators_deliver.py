# SPDX-License-Identifier: GPL-3.0-or-later
"""A clip, the mesh or the splats as a file, each at one click; the folder that holds the results."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
from bpy.props import EnumProperty

from ...scene import view
from ..job.job_operator import JobOperator, UserError
from ..job.task import Task
from ..operators_run import workspace_of

__all__ = ["FOLDER"]

FOLDER = "exports"
"""Of the workspace; a folder in it for each format."""


_ITEMS = (
    ("mp4", "Clip", "A clip of the clean frames, at the footage's size"),
    ("glb", "Mesh", "The mesh of the empty street, with its colors"),
    ("textured-glb", "Textured Mesh", "The mesh of the empty street, with textures"),
    ("splat-ply", "Splats", "The Gaussians of the empty street, as a PLY that splat viewers read"),
    ("spz", "Compressed Splats", "The Gaussians of the empty street, as SPZ"),
)


class UNVEIL_OT_deliver(JobOperator, bpy.types.Operator):
    """Write the empty street as a file for others, into the folder exports of the results"""

    bl_idname = "unveil.deliver"
    bl_label = "Write"

    what: EnumProperty(
        name="What",
        items=_ITEMS,
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        told = next(text for name, _, text in _ITEMS if name == properties.what)
        return f"{told}. It is written into the folder {FOLDER} of the results"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.has_results(cls, context) and super().poll(context)

    def title(self) -> str:
        return next(name for what, name, _ in _ITEMS if what == self.what)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        workspace = workspace_of(context.scene)
        if workspace is None:
            raise UserError("No results yet: import footage, or open the folder of results")
        return ["export", str(workspace), "--to", self.what, "-o", str(workspace / FOLDER / self.what)]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=None)


class UNVEIL_OT_open_results_folder(bpy.types.Operator):
    """Show the folder of the results in the system's file manager"""

    bl_idname = "unveil.open_results_folder"
    bl_label = "Show Results Folder"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        there = bool(context.scene.unveil.workspace)
        if not there:
            cls.poll_message_set("No results yet: press Unveil first")
        return there

    def execute(self, context: bpy.types.Context) -> set[str]:
        workspace = workspace_of(context.scene)
        if workspace is None or not workspace.is_dir():
            self.report({"ERROR"}, f"{workspace}: Not found (press Unveil, or Find Results)")
            return {"CANCELLED"}
        bpy.ops.wm.path_open(filepath=str(workspace))
        return {"FINISHED"}


CLASSES = (UNVEIL_OT_deliver, UNVEIL_OT_open_results_folder)
