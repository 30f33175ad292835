# SPDX-License-Identifier: GPL-3.0-or-later
"""Import footage: ``unveil solve`` finds the cameras of a clip or of photographs, and the drive that it writes is imported."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...formats.files import shown
from ...formats.table.run_settings import SHOWN
from ...scene import blocks, versions
from ...scene.settings import SET_UP_SCENE, START_FRAME, property_of
from ...worker.job_state import JobState
from ...worker.session import session
from ..job.job_operator import JobOperator, UserError
from ..job.sidebar import open_tab
from ..job.task import Task
from ..job.telling import tell
from ..preferences import preferences

__all__ = ["default_drive"]

CLIPS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".m2ts", ".mpg", ".mpeg", ".mxf", ".3gp", ".wmv")
SHOWN_FIRST = ("camera_height", "labels", "segmenter", "every", "focal", "lens", "speed", "thorough")
"""Settings in the order in which the dialog has them."""
_TABLE = {setting.name: property_of(setting) for setting in SHOWN if setting.name in ("labels", "segmenter")}


class UNVEIL_OT_import_footage(JobOperator, bpy.types.Operator, ImportHelper):
    """Find the cameras of a clip, or of photographs of one way, and import them as a street drive"""

    bl_idname = "unveil.import_footage"
    bl_label = "Import Footage"

    filename_ext = ""
    filter_glob: StringProperty(default=";".join(f"*{s}" for s in (*CLIPS, ".jpg", ".png", ".tif")), options={"HIDDEN"})
    drive: StringProperty(
        name="Drive",
        subtype="DIR_PATH",
        description="Folder that the drive is written to; empty: beside the .blend, or beside the footage",
    )
    workspace: StringProperty(
        name="Results Folder", subtype="DIR_PATH", description="Folder of the results; empty: beside the drive"
    )
    camera_height: FloatProperty(
        name="Camera Height",
        min=0.0,
        soft_max=4.0,
        default=0.0,
        precision=2,
        description="Metres of the camera above the road, from which the scale follows. 0: 1.6 m is assumed",
    )
    every: IntProperty(
        name="Every Nth Frame", default=1, min=1, soft_max=20, description="Of a clip: each N-th frame alone"
    )
    focal: StringProperty(
        name="Focal Length",
        description="In pixels as 1200, or as of 35 mm film, 26mm; empty: what the file notes, else found",
    )
    lens: EnumProperty(
        name="Lens",
        items=(
            ("simple", "Simple", "One radial term: most cameras and phones"),
            ("opencv", "Wide", "Two radial and two tangential terms"),
            ("fisheye", "Fisheye", "As of action cameras"),
        ),
    )
    speed: FloatProperty(
        name="Speed (km/h)",
        min=0.0,
        default=0.0,
        description="Mean speed, from which the scale follows in place of the height. 0: not known",
    )
    thorough: BoolProperty(name="Thorough", description="Three times the features, in three times the time")
    set_up_scene: BoolProperty(**SET_UP_SCENE)
    start_frame: IntProperty(**START_FRAME)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        chosen = preferences(context)
        if chosen is not None and not self.segmenter:
            self.segmenter = chosen.segmenter
        if self.properties.is_property_set("filepath"):  # dropped onto the window
            manager = context.window_manager
            return manager.invoke_props_dialog(self, width=440, title=self.bl_label, confirm_text="Import")
        if bpy.data.filepath:  # else Blender proposes the .blend's own name
            self.filepath = str(Path(bpy.data.filepath).parent) + os.sep
        return ImportHelper.invoke(self, context, event)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        if context.space_data is not None and context.space_data.type == "FILE_BROWSER":
            layout.label(text="Pick a clip, or a photograph")
        for names in (SHOWN_FIRST, ("drive", "workspace", "start_frame", "set_up_scene")):
            column = layout.column()
            for name in names:
                column.prop(self, name, **({"text": "Every Nth"} if name == "every" else {}))  # else it is cut off
                if name == "segmenter" and not (self.labels.strip() or self.segmenter.strip()):
                    column.label(text="Neither: outline by clicks later")

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not versions.has_window():
            return super().execute(context)
        open_tab(context)
        return self.start_following(context)  # who has answered a dialog does not wait in a window that stands still

    def arguments(self, context: bpy.types.Context) -> list[str]:
        footage = _footage_of(blocks.absolute(self.filepath)) if self.filepath else None
        if footage is None or not footage.exists():
            raise UserError(f"{shown(self.filepath)}: Not found (pick a clip, or a photograph of a folder)")
        options = [f"--lens={self.lens}", f"--every={self.every}", *["--thorough"] * self.thorough]
        for option, value in (("camera-height", self.camera_height), ("speed", self.speed)):
            options += [f"--{option}={value:g}"] if value > 0 else []
        for option in ("labels", "segmenter"):
            path = getattr(self, option).strip()
            options += [f"--{option}={blocks.absolute(path)}"] if path else []
        options += [f"--focal={self.focal.strip()}"] if self.focal.strip() else []
        return ["solve", str(footage), "-o", str(self._place(footage)), *options]

    def _place(self, footage: Path) -> Path:
        return blocks.absolute(self.drive) if self.drive else default_drive(footage, bpy.data.filepath)

    def task(self, context: bpy.types.Context) -> Task:
        settings = context.scene.unveil
        settings.set_up_scene, settings.start_frame = self.set_up_scene, self.start_frame
        place = self._place(_footage_of(blocks.absolute(self.filepath)))
        ended = partial(_solved, place, self.workspace, context.scene.name, session.file)
        return replace(super().task(context), ended=ended)


UNVEIL_OT_import_footage.__annotations__.update(_TABLE)


def default_drive(footage: Path, blend: str = "") -> Path:
    """Where the drive of footage is written if nobody says: beside the .blend, or beside the footage."""
    folder = Path(blend).parent if blend else footage.parent
    return folder / f"{footage.stem if footage.suffix else footage.name}_drive"


def _footage_of(path: Path) -> Path:
    """A clip itself; of a photograph the folder that it lies in."""
    return path if path.is_dir() or path.suffix.lower() in CLIPS else path.parent


def _solved(drive: Path, workspace: str, scene: str, file: int, context: bpy.types.Context, state: JobState) -> None:
    """The cameras are found: the drive is imported; what is wrong with it is an error of this job."""
    if state.status != "done":
        return
    if session.file != file or scene not in bpy.data.scenes:
        tell(f"The cameras are found: import {drive} into the file that is to have it", "WARNING")
        return
    for line in _assumed(state.answer.get("solve")):
        tell(line, "WARNING")
    settings = bpy.data.scenes[scene].unveil
    settings.labels = settings.segmenter = settings.frames = settings.cameras = (
        ""  # the drive has what follows from them
    )
    try:
        with context.temp_override(scene=bpy.data.scenes[scene]):
            bpy.ops.unveil.import_drive("INVOKE_DEFAULT", filepath=str(drive / "transforms.json"), workspace=workspace)
    except RuntimeError as error:
        state.status, state.error = "failed", str(error).removeprefix("Error: ").strip()


def _assumed(facts: object) -> list[str]:
    """What of a solve was not known and is assumed, a line each."""
    if not isinstance(facts, dict) or facts.get("scale_known", True):
        return []
    height = facts.get("camera_height_m")
    if not isinstance(height, int | float):
        return ["The scale is not known: import the footage again with its Camera Height"]
    return [
        f"The camera is assumed to be {height:g} m above the road: if not, import the footage again with its Camera Height"
    ]


class UNVEIL_FH_footage(bpy.types.FileHandler):
    """A clip dropped onto a 3D view"""

    bl_idname = "UNVEIL_FH_footage"
    bl_label = "Footage (Unveil)"
    bl_import_operator = "unveil.import_footage"
    bl_file_extensions = ";".join(CLIPS)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator(UNVEIL_OT_import_footage.bl_idname, text="Footage (Unveil)")


CLASSES = (UNVEIL_OT_import_footage, UNVEIL_FH_footage)


def register() -> None:
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
