# SPDX-License-Identifier: GPL-3.0-or-later
"""An operator that does nothing but report: Blender shows reports of operators alone, and not of those that scripts call."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, StringProperty

__all__: list[str] = []

SOON_S = 0.01


class UNVEIL_OT_tell(bpy.types.Operator):
    """Tell how work ended"""

    bl_idname = "unveil.tell"
    bl_label = "Unveil"
    bl_options = {"INTERNAL"}

    text: StringProperty(options={"SKIP_SAVE"})
    kind: EnumProperty(items=[(name, name.title(), "") for name in ("INFO", "WARNING", "ERROR")], options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """It ends with the next event, which Blender hands over itself: then its report is shown."""
        self._timer = context.window_manager.event_timer_add(SOON_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        self.cancel(context)
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.report({self.kind}, self.text)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)


CLASSES = (UNVEIL_OT_tell,)
