# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Remove of the sidebar: lists of classes and objects."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from ..choice import selection
from ..scene import drive_scene, view
from . import previews
from .panels import Section

__all__ = ["UNVEIL_PT_selection", "measures"]


class UNVEIL_UL_classes(bpy.types.UIList):
    """Classes: check box, colour, name, how many objects."""

    bl_idname = "UNVEIL_UL_classes"

    def draw_item(
        self,
        context: Any,
        layout: Any,
        data: Any,
        item: Any,
        icon: int,
        active_data: Any,
        active_property: str,
        index: int = 0,
        flt_flag: int = 0,
    ) -> None:
        row = layout.row(align=True)
        row.prop(item, "chosen", text="")
        row.label(text=item.name, icon_value=previews.chip(item.name))
        count = (
            f"{item.objects} object{'s' if item.objects != 1 else ''}" if item.objects else f"{item.points:,} points"
        )
        end = row.row()
        end.alignment = "RIGHT"
        end.label(text=count)

    def filter_items(self, context: Any, data: Any, property: str) -> tuple[list[int], list[int]]:
        everything = data.all_classes
        flags = [
            self.bitflag_filter_item if i.removable or i.chosen or everything else 0 for i in getattr(data, property)
        ]
        return flags, []


class UNVEIL_UL_objects(bpy.types.UIList):
    """Objects: check box, picture, class, size, distance, frames."""

    bl_idname = "UNVEIL_UL_objects"

    def draw_item(
        self,
        context: Any,
        layout: Any,
        data: Any,
        item: Any,
        icon: int,
        active_data: Any,
        active_property: str,
        index: int = 0,
        flt_flag: int = 0,
    ) -> None:
        columns = _columns(layout)
        row = columns[0]
        if item.moves:
            row.label(text="", icon="ANIM")
        else:
            row.prop(item, "chosen", text="")
        picture = previews.thumbnail(item.thumbnail, item.thumbnail_stamp)
        if picture:
            row.label(text=item.name, icon_value=picture)
        else:
            row.label(text=item.name, icon={"box": "CUBE", "mattes": "IMAGE_DATA"}.get(item.source, "QUESTION"))
        for column, text in zip(columns[1:], measures(item), strict=True):
            column.label(text=text)


def _columns(layout: bpy.types.UILayout) -> list[bpy.types.UILayout]:
    """What an object is, its size, distance and frames, side by side; of the same widths in the heading and in each row."""
    whole = layout.split(factor=0.44)
    thing = whole.row(align=True)  # what is made first stands first
    numbers = whole.split(factor=1 / 3)
    size = numbers.row()
    others = numbers.split(factor=0.5)
    return [thing, size, others.row(), others.row()]


def measures(item: selection.UnveilObject) -> tuple[str, str, str]:
    """Longest side and distance in metres, and how many frames show an object; empty where it is not known."""
    box, metre = selection.box_of(item), drive_scene.metre_of(item.id_data)
    return (
        f"{max(box.size) / metre:.1f}" if box is not None else "",
        f"{item.distance:.0f}" if item.distance >= 0 else "",
        str(item.frames) if item.frames else "",
    )


class UNVEIL_PT_selection(Section, bpy.types.Panel):
    """Lists of what can go."""

    bl_idname = "UNVEIL_PT_selection"
    bl_label = "Remove"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        listed = scene.unveil_selection
        if not selection.current(scene):
            layout.label(text="Import a drive to see what is in it", icon="INFO")
            return
        if view.shown_drive(scene) is None:
            layout.label(text="The drive is not in this scene any more", icon="INFO")
            layout.operator("unveil.load_workspace", text="Bring it back", icon="FILE_REFRESH").ask = False
        row = layout.row(align=True)
        for which, text in (("VEHICLES", "Vehicles"), ("PEOPLE", "People"), ("ALL", "All"), ("NONE", "None")):
            row.operator("unveil.choose", text=text).which = which
        layout.template_list("UNVEIL_UL_classes", "", listed, "classes", listed, "active_class", rows=3, sort_lock=True)
        layout.prop(listed, "all_classes")
        for column, text in zip(_columns(layout), ("Object", "Size", "Away", "Seen"), strict=True):
            column.label(text=text)
        layout.template_list("UNVEIL_UL_objects", "", listed, "objects", listed, "active", rows=6)
        layout.operator("unveil.outline_object", icon="RESTRICT_SELECT_OFF")
        row = layout.row(align=True)
        row.operator("unveil.add_box", icon="CUBE")
        row.operator("unveil.add_mattes", icon="IMAGE_DATA")
        row.prop(listed, "show_boxes", text="", icon="SHADING_BBOX")
        if 0 <= listed.active < len(listed.objects):
            self._active(layout, listed.objects[listed.active])
        problem = selection.problem(scene)
        lines = textwrap.wrap(problem or _summary(scene), 40)
        column = layout.column(align=True)
        for i, line in enumerate(lines):
            column.label(text=line, icon="BLANK1" if i else "ERROR" if problem else "CHECKMARK")

    def _active(self, layout: bpy.types.UILayout, thing: selection.UnveilObject) -> None:
        """More of the object whose row is active."""
        box = layout.box()
        row = box.row()
        picture = previews.thumbnail(thing.thumbnail, thing.thumbnail_stamp)
        if picture:
            row.template_icon(icon_value=picture, scale=4.0)
        column = row.column()
        column.label(text=thing.name)
        measured = selection.box_of(thing)
        if measured is not None:
            metre = drive_scene.metre_of(thing.id_data)
            column.label(text="×".join(f"{v / metre:.1f}" for v in measured.size) + " m")
        if thing.distance >= 0:
            column.label(text=f"{thing.distance:.1f} m from the drive")
        if thing.moves:
            column.label(text="moves: removed from every frame")
        elif thing.first_frame:
            column.label(text=f"{thing.frames} frames, {thing.first_frame} to {thing.last_frame}")
        if thing.chosen or thing.moves:
            row = box.row(align=True)
            row.prop(thing, "grow")
            row.prop(thing, "keep_shadow", toggle=True)
        row = box.row(align=True)
        row.operator("unveil.toggle_object", text="Keep" if thing.chosen else "Remove").number = thing.number
        row.operator("unveil.go_to_object", text="", icon="HIDE_OFF").number = thing.number
        if selection.is_marked(thing):
            row.operator("unveil.remove_mark", text="", icon="TRASH").number = thing.number


def _summary(scene: bpy.types.Scene) -> str:
    classes, numbers = selection.chosen_classes(scene), selection.chosen_numbers(scene)
    parts = [f"every {name}" for name in classes]
    if numbers:
        parts.append(f"{len(numbers)} single object{'s' if len(numbers) != 1 else ''}")
    return "Removed: " + ", ".join(parts)


CLASSES = (UNVEIL_UL_classes, UNVEIL_UL_objects, UNVEIL_PT_selection)
