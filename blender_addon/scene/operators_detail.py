# SPDX-License-Identifier: GPL-3.0-or-later
"""All triangles of a mesh on demand: what is loaded of a large one is decimated for the view."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..formats.drive_files import read_drive
from ..formats.files import one_line
from . import blocks, drive_scene, results, view

__all__: list[str] = []


class UNVEIL_OT_full_detail(bpy.types.Operator):
    """All triangles of the mesh that is shown, or those that are quick to draw again."""

    bl_idname = "unveil.full_detail"
    bl_label = "Full Detail"
    bl_description = (
        "Load all triangles of the mesh that is shown, or go back to those that are quick to draw. "
        "A .blend that is saved with all of them is large"
    )
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = view.shown_mesh(context.scene)
        return thing is not None and thing.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, thing = context.scene, view.shown_mesh(context.scene)
        collection = view.shown_drive(scene)
        if thing is None or collection is None:
            return {"CANCELLED"}
        workspace, state = Path(blocks.workspace_of(collection)), view.STATES[scene.unveil_view.state]
        before = bool(thing.get(view.FULL_DETAIL))
        thing[view.FULL_DETAIL] = not before
        try:
            there = results.load_mesh(collection, read_drive(workspace, drive_scene.metre_of(scene)), state)
            problem = "" if there else f"{workspace}: No mesh of this state yet (run the stage Mesh)"
        except (OSError, ValueError) as error:
            problem = one_line(error, workspace)
        if problem:
            thing[view.FULL_DETAIL] = before
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = (UNVEIL_OT_full_detail,)
