# SPDX-License-Identifier: GPL-3.0-or-later
"""``scene.unveil``: which drive, which workspace, which settings. Saved with the .blend."""

from __future__ import annotations

import math

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import blocks, versions

__all__ = ["UnveilSettings"]


def _workspace_named(self: UnveilSettings, context: bpy.types.Context) -> None:
    blocks.look_up([self.workspace])


class UnveilSettings(bpy.types.PropertyGroup):
    """The settings of a run, as ``unveil run --help`` has them."""

    drive: StringProperty(
        name="Drive",
        subtype="FILE_PATH",
        description="What was imported: a transforms.json, a COLMAP folder, …",
        options=versions.PATH,
    )
    workspace: StringProperty(
        name="Workspace",
        subtype="DIR_PATH",
        description="Folder of the results; work goes on there after a break",
        update=_workspace_named,
        options=versions.PATH,
    )
    quality: EnumProperty(
        name="Quality",
        items=(
            ("draft", "Draft", "A first look: smaller images, fewer steps"),
            ("standard", "Standard", "For most work"),
            ("high", "High", "Larger images, more steps, finer meshes"),
        ),
        default="standard",
    )
    device: EnumProperty(
        name="Device",
        items=(
            ("auto", "Automatic", "What the machine has"),
            ("cpu", "CPU", "Processor only"),
            ("cuda", "GPU", "NVIDIA graphics card"),
        ),
        default="auto",
    )
    set_up_scene: BoolProperty(
        name="Set up scene",
        default=True,
        description="Fit the scene to the drive: camera, resolution, frame range and rate, 3D views and Video Sequencer; "
        "off: nothing but the drive's own collection is touched",
    )
    start_frame: IntProperty(
        name="Start frame", default=1001, min=0, max=1_000_000, description="Frame of the timeline of the first picture"
    )
    frames: StringProperty(
        name="Frames", description="Part of the drive as FIRST:END:STEP, counted from 0, as 40:200:2; empty: all"
    )
    preview_frames: StringProperty(
        name="Preview frames",
        description="Frames of the timeline that a preview tries, as 1004,1050; empty: the present one and two others",
    )
    cameras: StringProperty(
        name="Cameras",
        description="Of a rig, as front,left; all: every one; empty: as the drive's kind has it, mostly the front",
    )
    seed: IntProperty(name="Seed", min=0, description="The same seed gives the same result")
    shadows: EnumProperty(
        name="Shadows",
        items=(
            ("auto", "Automatic", "Shadows of what goes are taken along; the sun is found by its shadows"),
            ("off", "Leave", "Shadows stay"),
            ("given", "Sun given", "As automatic, but you say where the sun stands"),
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
        name="Moving things",
        items=(
            ("auto", "Remove", "What moves during the drive goes from every frame"),
            ("keep", "As static", "Everything is treated as static"),
        ),
        default="auto",
    )
    order: EnumProperty(
        name="Order",
        items=(
            ("reverse", "Last frame first", "Nearest views invent for those farther away"),
            ("forward", "First frame first", "For comparison"),
            ("independent", "Each for itself", "For comparison"),
        ),
        default="reverse",
    )
    keyframes: StringProperty(
        name="Keyframes", description="Frames that invent what nobody saw, as 3,7; empty: chosen automatically"
    )
    inpainter: StringProperty(
        name="Inpainter",
        default="exemplar",
        description="For what is neither ground nor seen: exemplar, telea, navier-stokes, shift-map, fsr, or an ONNX file",
    )
    reference_inpainter: StringProperty(
        name="Reference inpainter",
        subtype="FILE_PATH",
        description="ONNX file that paints by a reference; none by default",
    )
    work_side: IntProperty(
        name="Largest side",
        min=0,
        subtype="PIXEL",
        description="Reduce larger images to this side; 0: as the quality says",
    )
    show_more: BoolProperty(name="More settings", default=False, options={"SKIP_SAVE"})


CLASSES = (UnveilSettings,)


def register() -> None:
    bpy.types.Scene.unveil = PointerProperty(type=UnveilSettings)


def unregister() -> None:
    del bpy.types.Scene.unveil
