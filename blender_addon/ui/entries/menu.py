# SPDX-License-Identifier: GPL-3.0-or-later
"""The menu Unveil of the 3D view: all that the sidebar has, found by F3, too, and by keys that the artist gives it."""

from __future__ import annotations

from typing import Any

import bpy

from ...scene import versions, view
from ...worker.session import session

__all__ = ["UNVEIL_MT_main"]


class UNVEIL_MT_remove(bpy.types.Menu):
    """What goes."""

    bl_idname = "UNVEIL_MT_remove"
    bl_label = "Remove"

    def draw(self, context: bpy.types.Context) -> None:
        layout, listed = self.layout, context.scene.unveil_selection
        for which, text in (("MOVABLE", "Vehicles and People"), ("VEHICLES", "Vehicles"), ("PEOPLE", "People")):
            layout.operator("unveil.choose", text=text).which = which
        for which, text in (("ALL", "All"), ("NONE", "None"), ("INVERT", "Invert")):
            layout.operator("unveil.choose", text=text).which = which
        layout.separator()
        layout.operator("unveil.choose_in_box")
        layout.operator("unveil.choose_similar")
        layout.operator("unveil.choose_shown")
        layout.operator("unveil.set_like_active")
        layout.operator("unveil.what_goes")
        layout.separator()
        layout.operator("unveil.add_box")
        layout.operator("unveil.add_mattes")
        layout.operator("unveil.outline_object")
        layout.operator("unveil.paint_mask")
        layout.operator("unveil.use_painted")
        layout.separator()
        layout.prop_menu_enum(listed, "boxes")
        layout.prop(listed, "ghosts")


class UNVEIL_MT_look(bpy.types.Menu):
    """What is shown."""

    bl_idname = "UNVEIL_MT_look"
    bl_label = "Look"

    def draw(self, context: bpy.types.Context) -> None:
        layout, shown = self.layout, context.scene.unveil_view
        layout.operator("unveil.before_after")
        layout.prop_menu_enum(shown, "compare")
        layout.prop_menu_enum(shown, "compare_with")
        layout.prop_menu_enum(shown, "background")
        layout.operator("unveil.keep_version")
        layout.operator("unveil.compare_version")
        layout.separator()
        for kind in ("POINTS", "MESH", *(("SPLATS",) if versions.has_native_splats() else ())):
            layout.prop_enum(shown, "shown", kind)
        layout.prop_menu_enum(shown, "points")
        layout.prop(shown, "points_in_camera")
        layout.separator()
        layout.operator("unveil.full_detail")
        layout.operator("unveil.load_workspace", text="Reload Results").ask = False


class UNVEIL_MT_output(bpy.types.Menu):
    """What leaves the add-on."""

    bl_idname = "UNVEIL_MT_output"
    bl_label = "Output"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("unveil.plates")
        layout.operator_enum("unveil.deliver", "what")
        layout.separator()
        layout.operator("unveil.set_up_cg")
        layout.operator("unveil.add_to_compositor")
        layout.operator("unveil.open_results_folder")


class UNVEIL_MT_main(bpy.types.Menu):
    """In the order of work."""

    bl_idname = "UNVEIL_MT_main"
    bl_label = "Unveil"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("unveil.open_drive", text="Import Street Drive…", icon="IMPORT")
        layout.operator("unveil.import_footage", text="Import Footage…", icon="FILE_MOVIE")
        layout.operator("unveil.use_shot", icon="CAMERA_DATA")
        layout.operator("unveil.load_workspace", text="Open Results…", icon="FILE_FOLDER").ask = True
        layout.operator("unveil.find_workspace")
        layout.separator()
        layout.menu("UNVEIL_MT_remove")
        layout.separator()
        layout.operator("unveil.preview", icon="HIDE_OFF")
        layout.operator("unveil.run", icon="PLAY")
        if session.busy:
            layout.operator("unveil.cancel", icon="CANCEL")
        layout.operator_menu_enum("unveil.stage", "stage", text="Run One Stage")
        layout.separator()
        layout.menu("UNVEIL_MT_look")
        layout.operator("unveil.next_doubtful", text="Check Doubtful Frames", icon="VIEWZOOM")
        layout.operator("unveil.paint_frame", icon="BRUSH_DATA")
        layout.operator("unveil.clone_from")
        layout.separator()
        layout.menu("UNVEIL_MT_output")
        layout.operator("unveil.show_report")
        layout.operator("unveil.show_log")
        layout.operator("unveil.show_preferences", icon="PREFERENCES")


def _draw(self: Any, context: bpy.types.Context) -> None:
    """In the view's header, where the scene has footage; before that, under Add-ons' usual place."""
    if context.mode == "OBJECT" and (view.shown_drive(context.scene) is not None or session.busy):
        self.layout.menu("UNVEIL_MT_main")


def _draw_in_object_menu(self: Any, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu("UNVEIL_MT_main")


CLASSES = (UNVEIL_MT_remove, UNVEIL_MT_look, UNVEIL_MT_output, UNVEIL_MT_main)


def register() -> None:
    bpy.types.VIEW3D_MT_editor_menus.append(_draw)
    bpy.types.VIEW3D_MT_object.append(_draw_in_object_menu)


def unregister() -> None:
    bpy.types.VIEW3D_MT_object.remove(_draw_in_object_menu)
    bpy.types.VIEW3D_MT_editor_menus.remove(_draw)
