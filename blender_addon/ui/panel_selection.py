# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Remove of the sidebar: lists of classes and objects."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from ..choice import box_gizmos, selection
from ..choice.quick import filters
from ..scene import drive_scene
from . import previews
from .panels import Section, is_narrow, split

__all__ = ["UNVEIL_PT_classes", "UNVEIL_PT_selection", "measures", "summary"]

LINE = 34
"""Characters that the sidebar has room for at its usual width."""


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
    """Objects: check box, picture, class, distance or what the list is sorted by, frames."""

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
        told = _told(item, data.filter.sort, is_narrow(context))
        whole = layout.split(factor=0.58 if len(told) > 1 else 0.76)
        row = whole.row(align=True)
        if item.moves:
            row.label(text="", icon="ANIM")
        else:
            row.prop(item, "chosen", text="")
        picture = previews.thumbnail(item.thumbnail, item.thumbnail_stamp)
        if picture:
            row.label(text=item.name, icon_value=picture)
        else:
            row.label(text=item.name, icon={"box": "CUBE", "mattes": "IMAGE_DATA"}.get(item.source, "QUESTION"))
        columns = whole.split(factor=1 / len(told))
        for text in told:
            cell = columns.row()
            cell.alignment = "RIGHT"
            cell.label(text=text)

    def filter_items(self, context: Any, data: Any, property: str) -> tuple[list[int], list[int]]:
        metre = drive_scene.metre_of(context.scene)
        let = filters.shown(data, metre)
        if self.filter_name:
            name = self.filter_name.lower()
            let = [ok and name in o.name.lower() for ok, o in zip(let, data.objects, strict=True)]
        return [self.bitflag_filter_item if ok else 0 for ok in let], filters.ranks(data, metre)


def _told(item: selection.UnveilObject, sort: str, narrow: bool) -> list[str]:
    """The columns beside a name: two, in a narrow sidebar one. What the list is sorted by is among them."""
    size, distance, frames = measures(item)
    long = size if sort == "SIZE" else distance
    columns = [f"{long} m" if long else "", f"{frames} f" if frames else ""]
    return columns[1:] if narrow and sort == "SEEN" else columns[:1] if narrow else columns


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

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return selection.current(context.scene)

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        listed = scene.unveil_selection
        row = layout.row(align=True)
        for which, text in (("VEHICLES", "Vehicles"), ("PEOPLE", "People"), ("ALL", "All"), ("NONE", "None")):
            row.operator("unveil.choose", text=text).which = which
        if listed.filter.opened:
            _filter(layout.box().column(), listed)
        row = layout.row()
        row.template_list("UNVEIL_UL_objects", "", listed, "objects", listed, "active", rows=6, sort_lock=True)
        _tools(row.column(align=True), listed)
        if 0 <= listed.active < len(listed.objects):
            self._active(layout, listed.objects[listed.active])
        problem = selection.problem(scene)
        lines = textwrap.wrap(problem or summary(scene), LINE)
        column = layout.column(align=True)
        for i, line in enumerate(lines):
            column.label(text=line, icon="BLANK1" if i else "ERROR" if problem else "INFO")

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
            column.label(text=" × ".join(f"{v / metre:.1f}" for v in measured.size) + " m")
        if thing.distance >= 0:
            column.label(text=f"{thing.distance:.1f} m away")
        if thing.moves:
            column.label(text="Moves: always removed")
        elif thing.first_frame:
            column.label(text=f"Frames {thing.first_frame} to {thing.last_frame}")
        if thing.chosen or thing.moves:
            row = box.row(align=True)
            row.prop(thing, "grow")
            row.prop(thing, "keep_shadow", toggle=True)
            row.operator("unveil.set_like_active", text="", icon="COPYDOWN")
        row = box.row(align=True)
        row.operator("unveil.go_to_object", text="Go to Best Frame", icon="HIDE_OFF").number = thing.number
        if selection.is_marked(thing):
            row.operator("unveil.remove_mark", text="", icon="TRASH").number = thing.number


def _filter(column: bpy.types.UILayout, listed: selection.UnveilSelection) -> None:
    """What the list shows, and in which order."""
    wanted = listed.filter
    row = column.row(align=True)
    row.prop(wanted, "sort", text="")
    row.prop(wanted, "reverse", text="", icon="SORT_DESC" if wanted.reverse else "SORT_ASC")
    column.prop_search(wanted, "class_name", listed, "classes", text="", icon="OUTLINER_OB_GROUP_INSTANCE")
    told = split(column)
    told.prop(wanted, "smallest", text="Size from (m)")
    told.prop(wanted, "farthest", text="Within (m)")
    told.prop(wanted, "fewest", text="Frames from")
    row = column.row(align=True)
    row.operator("unveil.choose_shown", text="Remove Shown").chosen = True
    row.operator("unveil.choose_shown", text="Keep Shown").chosen = False


def _tools(column: bpy.types.UILayout, listed: selection.UnveilSelection) -> None:
    """Beside the list, as Blender's own lists have them."""
    column.operator("unveil.add_box", text="", icon="CUBE")
    column.operator("unveil.add_mattes", text="", icon="IMAGE_DATA")
    column.operator("unveil.outline_object", text="", icon="RESTRICT_SELECT_OFF")
    column.separator()
    column.operator("unveil.choose_in_box", text="", icon="SELECT_SET")
    column.operator("unveil.choose_similar", text="", icon="SELECT_EXTEND")
    column.separator()
    column.prop(listed.filter, "opened", text="", icon="FILTER")
    column.prop_menu_enum(listed, "boxes", text="", icon="SHADING_BBOX")
    column.prop(listed, "ghosts", text="", icon="GHOST_ENABLED")


def summary(scene: bpy.types.Scene) -> str:
    classes, numbers = selection.chosen_classes(scene), selection.chosen_numbers(scene)
    parts = [f"every {name}" for name in classes]
    if numbers:
        parts.append(f"{len(numbers)} single object{'s' if len(numbers) != 1 else ''}")
    return "Will be removed: " + ", ".join(parts)


class UNVEIL_PT_classes(Section, bpy.types.Panel):
    """Whole classes, and what the colors of boxes mean."""

    bl_idname = "UNVEIL_PT_classes"
    bl_label = "Classes and Colors"
    bl_parent_id = "UNVEIL_PT_selection"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, listed = self.layout, context.scene.unveil_selection
        layout.template_list("UNVEIL_UL_classes", "", listed, "classes", listed, "active_class", rows=3, sort_lock=True)
        layout.prop(listed, "all_classes")
        row = layout.row(align=True)
        for text, color in (("Stays", box_gizmos.STAYS), ("Goes", box_gizmos.GOES), ("Moves", box_gizmos.MOVES)):
            row.label(text=text, icon_value=previews.plain_chip(text, color[:3]))


CLASSES = (UNVEIL_UL_classes, UNVEIL_UL_objects, UNVEIL_PT_selection, UNVEIL_PT_classes)
