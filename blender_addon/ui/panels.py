# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's tab: one panel a section. Each section's own panel is a subclass of :class:`Section` in its owner's file."""

from __future__ import annotations

import bpy

__all__ = ["Section", "UNVEIL_PT_main"]


class UNVEIL_PT_main(bpy.types.Panel):
    """The frame that holds the sections."""

    bl_idname = "UNVEIL_PT_main"
    bl_label = "Unveil"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Unveil"

    def draw(self, context: bpy.types.Context) -> None:
        pass


class Section:
    """What the panels of the sections share. ``bl_order``: the button 0, drive 1, what goes 2, run 3, results 4."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Unveil"
    bl_parent_id = "UNVEIL_PT_main"


CLASSES = (UNVEIL_PT_main,)
