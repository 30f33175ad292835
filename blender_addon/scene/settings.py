# SPDX-License-Identifier: GPL-3.0-or-later
"""``scene.unveil``: which drive, which workspace, which settings. Saved with the .blend."""

from __future__ import annotations

import math
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import blocks, versions

__all__ = ["CAMERAS", "SET_UP_SCENE", "START_FRAME", "UnveilSettings"]


SET_UP_SCENE: dict[str, Any] = {
    "name": "Set up scene",
    "default": True,
    "description": "Fit the scene to the drive: camera, resolution, frame range and rate, 3D views and Video Sequencer; "
    "off: nothing but the drive's own collection is touched",
}
START_FRAME: dict[str, Any] = {
    "name": "Start frame",
    "default": 1001,
    "min": 0,
    "max": 1_000_000,
    "description": "Frame of the timeline of the first picture",
}
CAMERAS: dict[str, Any] = {
    "name": "Cameras",
    "description": "Of a rig, as front,left; all: every one; empty: the front camera, where the drive names one",
}
"""Settings that the import dialog asks for, too."""


def _workspace_named(self: UnveilSettings, context: bpy.types.Context) -> None:
    blocks.look_up([self.workspace])


def _inpainters(self: UnveilSettings, context: bpy.types.Context, text: str) -> list[str]:
    """Names to choose from; an ONNX file may be typed as well."""
    return [name for name in ("exemplar", "telea", "navier-stokes", "shift-map", "fsr") if text in name]


class UnveilSettings(bpy.types.PropertyGroup):
    """The settings of a run, as ``unveil run --help`` has them."""

    drive: StringProperty(
        name="Drive",
        subtype="FILE_PATH",
        description="What was imported: a transforms.json, a COLMAP folder, …",
        options=versions.PATH,
    )
    workspace: StringProperty(
        name="Results folder",
        subtype="DIR_PATH",
        description="Folder of the results; a run that was cancelled continues from what is finished there",
        update=_workspace_named,
        options=versions.PATH,
    )
    quality: EnumProperty(
        name="Quality",
        items=(
            ("draft", "Draft", "A first look, in minutes: smaller images, fewer steps"),
            ("standard", "Standard", "For most work; about three times as long as a draft"),
            ("high", "High", "Larger images, more steps, finer meshes"),
        ),
        default="standard",
    )
    device: EnumProperty(
        name="Device",
        items=(
            (
                "auto",
                "Automatic",
                "An NVIDIA GPU where one can be used, else the processor; Check in the preferences tells",
            ),
            ("cpu", "CPU", "The processor alone"),
            ("cuda", "GPU", "An NVIDIA GPU alone; a run is refused where none can be used"),
        ),
        default="auto",
    )
    set_up_scene: BoolProperty(**SET_UP_SCENE)
    start_frame: IntProperty(**START_FRAME)
    frames: StringProperty(
        name="Frames", description="Part of the drive as FIRST:END:STEP, counted from 0, as 40:200:2; empty: all"
    )
    preview_frames: StringProperty(
        name="Preview frames",
        description="Frames of the timeline that a preview tries, as 1004,1050; empty: the present one and two others",
    )
    cameras: StringProperty(**CAMERAS)
    seed: IntProperty(name="Seed", min=0, description="The same seed gives the same result")
    shadows: EnumProperty(
        name="Shadows",
        items=(
            ("auto", "Automatic", "Shadows of removed objects are removed too; the sun's direction is estimated"),
            ("off", "Keep", "Shadows of removed objects stay in the pictures"),
            ("given", "Given sun", "As Automatic, with the sun's direction from Azimuth and Elevation"),
        ),
        default="auto",
    )
    sun_azimuth: FloatProperty(
        name="Azimuth",
        subtype="ANGLE",
        default=math.radians(135),
        soft_min=0,
        soft_max=2 * math.pi,
        description="Direction towards the sun, clockwise from the y axis (north)",
    )
    sun_elevation: FloatProperty(
        name="Elevation",
        subtype="ANGLE",
        default=math.radians(40),
        min=math.radians(0.1),
        max=math.pi / 2,
        description="Height of the sun above the horizon",
    )
    movers: EnumProperty(
        name="Dynamic objects",
        items=(
            ("auto", "Remove", "Objects that move during the drive are removed from every frame"),
            ("keep", "As static", "They are treated as static objects"),
        ),
        default="auto",
    )
    order: EnumProperty(
        name="Fill order",
        items=(
            (
                "reverse",
                "Last frame first",
                "Holes are filled in the last frame first, which earlier ones take their fill from",
            ),
            ("forward", "First frame first", "The other way round, for comparison"),
            ("independent", "Each for itself", "No frame takes another's fill, for comparison"),
        ),
        default="reverse",
    )
    keyframes: StringProperty(
        name="Keyframes",
        description="Frames in which unobserved content is inpainted for all others, as 3,7; empty: chosen automatically",
    )
    inpainter: StringProperty(
        name="Inpainter",
        default="exemplar",
        search=_inpainters,
        search_options={"SUGGESTION"},
        description="Fills what no frame has seen, but ground: exemplar, telea, navier-stokes, shift-map, fsr, or an ONNX file",
    )
    reference_inpainter: StringProperty(
        name="Reference inpainter",
        subtype="FILE_PATH",
        description="ONNX file of a network that inpaints by a reference picture; empty: none",
    )
    work_side: IntProperty(
        name="Longer side",
        min=0,
        subtype="PIXEL",
        description="Larger images are reduced until their longer side has so many pixels; 0: as Quality says",
    )
    show_more: BoolProperty(name="More settings", default=False, options={"SKIP_SAVE"})


CLASSES = (UnveilSettings,)


def register() -> None:
    bpy.types.Scene.unveil = PointerProperty(type=UnveilSettings)


def unregister() -> None:
    del bpy.types.Scene.unveil
