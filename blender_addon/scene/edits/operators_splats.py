# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussians that the artist edited become a state of the workspace, ``--state edited`` of ``unveil export`` and ``render``."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...formats.files import one_line, own_folder, write_whole
from ...formats.ply_file import read_ply
from ...formats.splat_files.splat_ply import splat_ply
from .. import blocks, view
from .edited_cloud import edited_gaussians

__all__ = ["FILE"]

FILE = "edited.ply"
ROLE = "splats:empty"


class UNVEIL_OT_keep_splats(bpy.types.Operator):
    """Keep the Gaussians of the empty street as you edited them, for unveil export and render: --state edited"""

    bl_idname = "unveil.keep_splats"
    bl_label = "Keep Edited Gaussians"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = _cloud(context)
        if thing is None:
            cls.poll_message_set("Load results that have Gaussians; Blender draws and edits them since 5.3")
        return thing is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = _cloud(context)
        collection = view.shown_drive(context.scene)
        assert thing is not None and collection is not None
        workspace = Path(blocks.workspace_of(collection))
        if thing.mode == "EDIT":  # what is edited is not in the data before
            thing.update_from_editmode()
        try:
            gaussians, facts = edited_gaussians(context, thing)
            made = workspace / "surfels/empty.ply"
            path = own_folder(workspace, "surfels") / FILE
            write_whole(path, splat_ply(gaussians, facts, read_ply(made).comments), like=made)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, one_line(error, workspace))
            return {"CANCELLED"}
        before = int(thing.get("unveil_gaussians", len(gaussians)))
        self.report({"INFO"}, f"{path}: {len(gaussians):,} of {before:,} Gaussians")
        return {"FINISHED"}


def _cloud(context: bpy.types.Context) -> bpy.types.Object | None:
    """The empty street's Gaussians, where this Blender has them."""
    collection = view.shown_drive(context.scene)
    if collection is None:
        return None
    thing = blocks.find(bpy.data.objects, blocks.drive_of(collection), ROLE)
    return thing if thing is not None and thing.type == "POINTCLOUD" else None


CLASSES = (UNVEIL_OT_keep_splats,)
