# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a drive is shown: ``scene.unveil_view``, and the switch between before and after."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty

from . import blocks, cameras, meshes
from .images import plates

__all__ = [
    "CG",
    "FIGURES",
    "FULL_DETAIL",
    "UnveilView",
    "apply",
    "has_results",
    "is_decimated",
    "shown_drive",
    "shown_mesh",
    "when_changed",
]

ROLES = {"POINTS": ("points",), "MESH": ("mesh",), "SPLATS": ("splats",)}
STATES = {"BEFORE": "full", "AFTER": "empty"}
FULL_DETAIL = "unveil_full_detail"
"""Custom property of a mesh's object: whether all of its file is shown."""
FIGURES = "unveil_figures"
"""Custom property of a drive's collection: which figures its results have, by the time that their file was written."""
CG = "unveil_cg"
"""Custom property of a drive's collection: whether the scene renders the artist's objects over its clean plate."""


when_changed: list[Callable[[bpy.types.Scene], None]] = []
"""Called with the scene after :func:`apply`: what is drawn over the views follows."""


def _state_changed(self: UnveilView, context: bpy.types.Context) -> None:
    """Photographs and clean frames are the background's before and after; another background was chosen, and stays."""
    if self.background in ("original", "clean"):
        self.background = "clean" if self.state == "AFTER" else "original"
    apply(self.id_data)


def _changed(self: UnveilView, context: bpy.types.Context) -> None:
    apply(self.id_data)


def _redraw(self: UnveilView, context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class UnveilView(bpy.types.PropertyGroup):
    """Saved with the .blend."""

    state: EnumProperty(
        name="State",
        items=(
            ("BEFORE", "Before", "Photographs and mesh of the street as it was"),
            ("AFTER", "After", "Clean frames and mesh of the empty street"),
        ),
        default="BEFORE",
        update=_state_changed,
    )
    shown: EnumProperty(
        name="Show",
        items=(
            ("POINTS", "Points", "LiDAR or structure-from-motion points"),
            ("MESH", "Mesh", "The fused mesh"),
            ("SPLATS", "Gaussians", "The Gaussian scene as splats, in a Blender that draws them: 5.3 or newer"),
        ),
        options={"ENUM_FLAG"},
        default={"POINTS"},
        update=_changed,
    )
    points: EnumProperty(
        name="Point Color",
        items=(("COLOUR", "Photo", "As photographed"), ("CLASS", "Class", "By their semantic class")),
        default="COLOUR",
        update=_changed,
    )
    points_in_camera: BoolProperty(
        name="Points in Camera View",
        description="Draw the points over the picture, too, where a view looks through a camera",
        update=_redraw,
    )
    point_size: FloatProperty(
        name="Point Size",
        description="Diameter of a point 12 m away, in pixels; farther ones are smaller",
        subtype="PIXEL",
        default=3.0,
        min=1.0,
        max=20.0,
        update=_redraw,
    )
    point_reach: FloatProperty(
        name="Point Distance",
        description="Points farther from the viewer than this are not drawn, in metres; 0: all are",
        default=80.0,
        min=0.0,
        soft_max=500.0,
        update=_redraw,
    )
    compare: EnumProperty(
        name="Compare",
        description="Draw a second picture over the first, in the camera's view and in the Image Editor",
        items=(
            ("NONE", "Off", "One picture alone"),
            ("WIPE", "Wipe", "The other picture to the right of a line that can be dragged"),
            (
                "DIFFERENCE",
                "Difference",
                "Where the two differ: black is alike, yellow is a quarter of full scale or more",
            ),
            ("ORIGIN", "Origins", "Where each removed pixel comes from: seen in other frames, continued, or made up"),
        ),
        default="NONE",
        update=_changed,
    )
    wipe: FloatProperty(
        name="Wipe",
        description="Where the line stands: share of the picture's width from the left",
        subtype="FACTOR",
        default=0.5,
        min=0.0,
        max=1.0,
        update=_redraw,
    )
    compare_with: EnumProperty(
        name="With",
        description="The picture that the background is compared with",
        items=plates.KINDS,
        default="original",
        update=_changed,
    )
    background: EnumProperty(
        name="Background",
        description="What the camera shows behind the scene",
        items=(*plates.KINDS, ("none", "None", "Nothing")),
        default="original",
        update=_changed,
    )


def shown_drive(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of the scene's workspace, None before its import."""
    place = scene.unveil.workspace
    return blocks.drive_collection(scene, place) if place else None


def has_results(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether the drive that is shown has clean frames, for the poll of an operator, which says so where it has none."""
    collection = shown_drive(context.scene)
    there = collection is not None and bool(collection.get("unveil_clean"))
    if not there:
        operator.poll_message_set("No results yet: press Unveil first")
    return there


def shown_mesh(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The object of the fused mesh of the state that is looked at, None where there is none."""
    collection = shown_drive(scene)
    if collection is None:
        return None
    role = f"mesh:{STATES[scene.unveil_view.state]}"
    return blocks.find(bpy.data.objects, blocks.drive_of(collection), role)


def is_decimated(mesh: bpy.types.Object) -> bool:
    """Whether a mesh's object shows fewer triangles than its file has."""
    return int(mesh.get("unveil_triangles", 0)) > int(mesh.get("unveil_triangles_shown", 0))


def apply(scene: bpy.types.Scene) -> None:
    """Bring the drive's collections, cameras and points in line with the settings."""
    collection = shown_drive(scene)
    if collection is None:
        return
    view = scene.unveil_view
    for child in collection.children:
        kind, _, state = str(child.get(blocks.ROLE, "")).partition(":")
        flag = next((name for name, roles in ROLES.items() if kind in roles), None)
        if flag is not None:
            visible = flag in view.shown and state in ("", STATES[view.state])
            child.hide_viewport = child.hide_render = not visible
            if collection.get(CG):  # what takes the shadows is rendered, and nothing that would cover the plate
                child.hide_render = (kind, state) != ("mesh", "empty")
    for thing in collection.all_objects:
        if cameras.track_of(thing) is not None:
            plates.show_plate(thing, view.background)
    points = blocks.find(bpy.data.meshes, blocks.drive_of(collection), "points")
    if points is not None:
        meshes.show_colors(points, "Class" if view.points == "CLASS" else "Colour")
    for follow in when_changed:
        follow(scene)


CLASSES = (UnveilView,)


def register() -> None:
    bpy.types.Scene.unveil_view = PointerProperty(type=UnveilView)


def unregister() -> None:
    del bpy.types.Scene.unveil_view
