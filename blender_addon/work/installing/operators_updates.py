# SPDX-License-Identifier: GPL-3.0-or-later
"""Look for a newer version of the add-on where it came from."""

from __future__ import annotations

import bpy

__all__: list[str] = []


class UNVEIL_OT_check_for_updates(bpy.types.Operator):
    """Ask the repositories of Blender's preferences for newer versions, and show what there is. An add-on installed from a zip has
    none: name the folder or address of its repository under Get Extensions > Repositories"""

    bl_idname = "unveil.check_for_updates"
    bl_label = "Check for Updates"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not bpy.app.online_access:
            self.report({"WARNING"}, "Blender is offline: repositories on this machine alone are asked")
        bpy.ops.extensions.repo_sync_all()
        if not bpy.app.background and context.window_manager.windows:
            bpy.ops.screen.userpref_show(section="EXTENSIONS")
            context.window_manager.extension_search = "Unveil"
        return {"FINISHED"}


CLASSES = (UNVEIL_OT_check_for_updates,)
