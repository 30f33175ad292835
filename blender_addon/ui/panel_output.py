# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Output of the sidebar: results for other programs, each at one click, and the scene that renders over them."""

from __future__ import annotations

from typing import Any

import bpy

from ..scene import cameras, versions, view
from ..scene.images import compositing
from .panels import Section

__all__ = ["UNVEIL_PT_objects_back", "UNVEIL_PT_output"]


class UNVEIL_PT_output(Section, bpy.types.Panel):
    """What leaves the add-on."""

    bl_idname = "UNVEIL_PT_output"
    bl_label = "Output"
    bl_order = 6
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        collection = view.shown_drive(context.scene)
        return collection is not None and bool(collection.get("unveil_clean"))

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        if compositing.in_lens(context.scene):
            column.operator_menu_enum("unveil.plates", "lens", text="Plates", icon="IMAGE_DATA")
        else:
            column.operator("unveil.plates", text="Plates", icon="IMAGE_DATA")
        row = column.row(align=True)
        for what, text, icon in (
            ("mp4", "Clip", "FILE_MOVIE"),
            ("glb", "Mesh", "MESH_DATA"),
            ("splat-ply", "Splats", "OUTLINER_OB_POINTCLOUD"),
        ):
            row.operator("unveil.deliver", text=text, icon=icon).what = what
        column = self.layout.column(align=True)
        column.operator("unveil.set_up_cg", icon="RENDER_STILL")
        column.operator("unveil.add_to_compositor", icon="NODE_COMPOSITING")
        self.layout.operator("unveil.open_results_folder", icon="FILE_FOLDER")


class UNVEIL_PT_objects_back(Section, bpy.types.Panel):
    """A slider for each removed object: how much of it the compositor takes out."""

    bl_idname = "UNVEIL_PT_objects_back"
    bl_label = "Objects in the Compositor"
    bl_parent_id = "UNVEIL_PT_output"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _group_node(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        node = _group_node(context.scene)
        column = self.layout.column(align=True)
        for socket in node.inputs:
            column.prop(socket, "default_value", text=socket.name, slider=True)


def _group_node(scene: bpy.types.Scene) -> Any:
    """The node of the plates in the scene's compositor, of the camera that is looked through first; None where there is none."""
    tree = versions.shown_compositor(scene)
    if tree is None:
        return None
    track = cameras.track_of(scene.camera)
    tracks = [track, *(str(c["unveil_track"]) for c in compositing.tracks_of(scene))] if track else []
    for name in tracks:
        group = compositing.group_of(scene, str(name))
        node = next((n for n in tree.nodes if group is not None and getattr(n, "node_tree", None) == group), None)
        if node is not None:
            return node
    return None


CLASSES = (UNVEIL_PT_output, UNVEIL_PT_objects_back)
