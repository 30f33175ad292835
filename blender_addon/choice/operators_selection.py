# SPDX-License-Identifier: GPL-3.0-or-later
"""Choosing what goes: toggling objects and classes, and marking what nobody labelled."""

from __future__ import annotations

import math

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from ..formats.boxes import SceneBox
from ..formats.classes import VEHICLES
from ..formats.sequences import pictures_in
from ..scene import drive_scene, view
from . import marks, selection
from .quick import ground as marks_place

__all__ = ["new_entry"]

BOX_SIZE_M = (4.5, 1.9, 1.6)
"""Of a new box: a car's."""
PEOPLE = ("person", "rider")


class UNVEIL_OT_toggle_object(bpy.types.Operator):
    """Take this object out, or leave it in"""

    bl_idname = "unveil.toggle_object"
    bl_label = "Choose Object"
    bl_options = {"REGISTER", "UNDO"}

    number: IntProperty(description="The object's id")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _has_list(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        listed = context.scene.unveil_selection
        for i, thing in enumerate(listed.objects):
            if thing.number == self.number:
                thing.chosen, listed.active = not thing.chosen, i
                self.report({"INFO"}, f"{thing.name} {'is removed' if thing.chosen or thing.moves else 'stays'}")
                return {"FINISHED"}
        self.report({"ERROR"}, f"There is no object {self.number}")
        return {"CANCELLED"}


class UNVEIL_OT_choose(bpy.types.Operator):
    """Choose many objects at once"""

    bl_idname = "unveil.choose"
    bl_label = "Choose Objects"
    bl_options = {"REGISTER", "UNDO"}

    which: EnumProperty(
        name="Which",
        items=(
            ("ALL", "All", "Everything in the list"),
            ("NONE", "None", "Nothing at all"),
            ("INVERT", "Invert", "Choose what is not chosen, and the other way round"),
            ("VEHICLES", "Vehicles", "Cars, trucks, buses, trains, motorcycles, bicycles"),
            ("PEOPLE", "People", "Pedestrians and riders"),
            ("MOVABLE", "Vehicles and People", "All that usually goes"),
            ("CLASS", "Class", "All of one class"),
        ),
    )
    class_name: StringProperty(options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _has_list(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        listed = context.scene.unveil_selection
        names = {
            "VEHICLES": VEHICLES,
            "PEOPLE": PEOPLE,
            "MOVABLE": (*VEHICLES, *PEOPLE),
            "CLASS": (self.class_name,),
        }.get(self.which)
        if self.which == "CLASS" and self.class_name not in {o.class_name for o in listed.objects} | set(
            listed.classes.keys()
        ):
            self.report({"ERROR"}, f"The drive has no {self.class_name}")
            return {"CANCELLED"}
        for thing in listed.objects:
            if names is None:
                thing.chosen = {"ALL": True, "NONE": False, "INVERT": not thing.chosen}[self.which]
            elif thing.class_name in names:
                thing.chosen = True
        for item in listed.classes:
            if self.which == "NONE":
                item.alone = False
            elif names is not None and item.name in names and not item.objects:
                item.alone = True
        return {"FINISHED"}


class UNVEIL_OT_go_to_object(bpy.types.Operator):
    """Go to a frame that shows this object"""

    bl_idname = "unveil.go_to_object"
    bl_label = "Show Object"
    bl_options = {"REGISTER", "UNDO"}

    number: IntProperty()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _has_list(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = next((o for o in context.scene.unveil_selection.objects if o.number == self.number), None)
        if thing is None or thing.best_frame < 0:
            self.report({"WARNING"}, "No frame shows it")
            return {"CANCELLED"}
        context.scene.frame_set(thing.best_frame)
        if thing.best_track and view.shown_drive(context.scene) is not None:  # an artist may have deleted it
            bpy.ops.unveil.look_through(track=thing.best_track)
        return {"FINISHED"}


# ----------------------------------------------------------------------------------------------------------- marking by hand


class UNVEIL_OT_add_box(bpy.types.Operator):
    """Put a wire cube on the ground amid the view; move, turn and scale it around what is to go"""

    bl_idname = "unveil.add_box"
    bl_label = "Add Box"
    bl_options = {"REGISTER", "UNDO"}

    class_name: StringProperty(name="Name", default="box", description="Name of the object in the list")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _can_mark(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, collection = context.scene, view.shown_drive(context.scene)
        assert collection is not None
        thing = new_entry(scene, self.class_name.strip() or "box", "box")
        x, y, z = marks_place.on_ground(context)
        length, width, height = (v * drive_scene.metre_of(scene) for v in BOX_SIZE_M)
        box = SceneBox((x, y, z + height / 2), (length, width, height), _heading(scene))
        thing.marker = marks.new_marker(collection, thing.number, thing.class_name, box)
        for other in context.view_layer.objects:
            other.select_set(False)
        thing.marker.select_set(True)
        context.view_layer.objects.active = thing.marker
        return {"FINISHED"}


class UNVEIL_OT_add_mattes(bpy.types.Operator):
    """Take an object from a sequence of pictures that are white where it is, one for each frame or for some"""

    bl_idname = "unveil.add_mattes"
    bl_label = "Add Mattes"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(name="Folder", subtype="DIR_PATH")
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})
    filter_image: BoolProperty(default=True, options={"HIDDEN"})
    class_name: StringProperty(name="Name", default="object", description="Name of the object in the list")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _can_mark(cls, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        count = len(pictures_in(bpy.path.abspath(self.directory)))
        if not count:
            self.report({"ERROR"}, f"{self.directory}: holds no pictures (choose the folder of a sequence)")
            return {"CANCELLED"}
        thing = new_entry(context.scene, self.class_name.strip() or "object", "mattes")
        thing.mattes, thing.frames = self.directory, count
        return {"FINISHED"}


class UNVEIL_OT_remove_mark(bpy.types.Operator):
    """Delete a mark that was made by hand; the object stays in the street"""

    bl_idname = "unveil.remove_mark"
    bl_label = "Delete Mark"
    bl_options = {"REGISTER", "UNDO"}

    number: IntProperty()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _has_list(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        listed = context.scene.unveil_selection
        for i, thing in enumerate(listed.objects):
            if thing.number == self.number and selection.is_marked(thing):
                marker = thing.marker
                listed.objects.remove(i)
                listed.active = min(listed.active, max(len(listed.objects) - 1, 0))
                if marker is not None:
                    bpy.data.objects.remove(marker)
                return {"FINISHED"}
        self.report({"ERROR"}, f"There is no mark {self.number}")
        return {"CANCELLED"}


def _has_list(cls: type, context: bpy.types.Context) -> bool:
    ready = selection.current(context.scene)
    if not ready:
        cls.poll_message_set("Import a drive first")  # type: ignore[attr-defined]
    return ready


def _can_mark(cls: type, context: bpy.types.Context) -> bool:
    ready = context.mode == "OBJECT" and view.shown_drive(context.scene) is not None
    if not ready:
        cls.poll_message_set("Import a drive first, and be in Object Mode")  # type: ignore[attr-defined]
    return ready


def new_entry(scene: bpy.types.Scene, class_name: str, source: str) -> selection.UnveilObject:
    """A new, chosen entry of the list, made active."""
    listed = scene.unveil_selection
    number = marks.free_number(o.number for o in listed.objects)
    thing = listed.objects.add()
    thing.number, thing.class_name, thing.source, thing.row = number, class_name, source, selection.MARKED
    thing.name, thing.chosen, thing.distance, thing.best_frame = f"{class_name} {number}", True, -1.0, -1
    listed.active = len(listed.objects) - 1
    return thing


def _heading(scene: bpy.types.Scene) -> float:
    """Yaw of the way that the scene's camera looks: cars mostly stand along the street."""
    if scene.camera is None:
        return 0.0
    matrix = scene.camera.matrix_world
    return math.atan2(-matrix[1][2], -matrix[0][2])


CLASSES = (
    UNVEIL_OT_toggle_object,
    UNVEIL_OT_choose,
    UNVEIL_OT_go_to_object,
    UNVEIL_OT_add_box,
    UNVEIL_OT_add_mattes,
    UNVEIL_OT_remove_mark,
)
