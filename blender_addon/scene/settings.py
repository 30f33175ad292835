# SPDX-License-Identifier: GPL-3.0-or-later
"""``scene.unveil``: which drive, which workspace, which settings. Saved with the .blend."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..formats.table.run_settings import SHOWN, RunSetting
from . import blocks, versions

__all__ = ["CAMERAS", "ON_TYPED", "SET_UP_SCENE", "START_FRAME", "UnveilSettings", "property_of"]


SET_UP_SCENE: dict[str, Any] = {
    "name": "Set Up Scene",
    "default": True,
    "description": "Fit the scene to the drive: camera, resolution, frame range and rate, 3D views and Video Sequencer; "
    "off: nothing but the drive's own collection is touched",
}
START_FRAME: dict[str, Any] = {
    "name": "Start Frame",
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


ON_TYPED: list[Callable[[Any], None]] = []
"""Called with the ``scene.unveil`` whose results folder was named by hand."""


def _typed(self: UnveilSettings, folder: str) -> None:
    self.workspace = folder
    for told in ON_TYPED:
        told(self)


def _inpainters(self: UnveilSettings, context: bpy.types.Context, text: str) -> list[str]:
    """Names to choose from; an ONNX file may be typed as well."""
    return [name for name in ("exemplar", "telea", "navier-stokes", "shift-map", "fsr") if text in name]


def property_of(setting: RunSetting) -> Any:
    """A property for a setting of the table."""
    usual = f". Empty: {setting.usual or setting.default}" if isinstance(setting.start, str) else ""
    told: dict[str, Any] = {"name": setting.label, "default": setting.start, "description": setting.help}
    if setting.shape == "flag":
        return BoolProperty(**told)
    if setting.choices:  # the shadows, too
        known = tuple((name, label, text or setting.help) for name, label, text in setting.choices)
        automatic = (("auto", "Automatic", f"{setting.help}: {setting.usual}"),)
        return EnumProperty(**told, items=automatic + known if setting.default is None else known)
    if setting.shape in ("whole", "number"):
        nothing = setting.nothing if setting.default is None else setting.low
        told["description"] += f". {nothing}: {setting.usual}" if setting.default is None else ""
        if setting.shape == "whole":
            return IntProperty(**told, min=nothing, subtype="PIXEL" if setting.measure == "px" else "NONE")
        return FloatProperty(**told, min=nothing, precision=3)
    told["description"] += usual
    if setting.shape == "network":
        return StringProperty(**told, search=_inpainters, search_options={"SUGGESTION"})
    if setting.shape in ("file", "folder"):
        subtype = "FILE_PATH" if setting.shape == "file" else "DIR_PATH"
        return StringProperty(**told, subtype=subtype, options=versions.PATH)
    return StringProperty(**told)


class UnveilSettings(bpy.types.PropertyGroup):
    """The settings of a run, as ``unveil run --help`` has them; those of the table are added below."""

    drive: StringProperty(
        name="Drive",
        subtype="FILE_PATH",
        description="What was imported: a transforms.json, a COLMAP folder, …",
        options=versions.PATH,
    )
    workspace: StringProperty(
        name="Results Folder",
        subtype="DIR_PATH",
        description="Folder of the results; a run that was cancelled continues from what is finished there",
        update=_workspace_named,
        options=versions.PATH,
    )
    results_folder: StringProperty(
        name="Results Folder",
        subtype="DIR_PATH",
        description="Folder of the results; where it holds some of this drive, their settings are taken over",
        get=lambda self: self.workspace,
        set=_typed,
        options=versions.PATH | {"SKIP_SAVE"},
    )
    set_up_scene: BoolProperty(**SET_UP_SCENE)
    start_frame: IntProperty(**START_FRAME)
    preview_frames: StringProperty(
        name="Preview Frames",
        description="Frames of the timeline that a preview tries, as 1004,1050; empty: the present one",
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
    made_with: StringProperty(options={"HIDDEN"})
    show_more: BoolProperty(
        name="Advanced", description="Show the settings for experts", default=False, options={"SKIP_SAVE"}
    )


UnveilSettings.__annotations__.update({setting.name: property_of(setting) for setting in SHOWN})

CLASSES = (UnveilSettings,)


def register() -> None:
    bpy.types.Scene.unveil = PointerProperty(type=UnveilSettings)


def unregister() -> None:
    del bpy.types.Scene.unveil
