# SPDX-License-Identifier: GPL-3.0-or-later
"""An object of a few clicks: the artist clicks on it in one frame, Unveil outlines it in all, and it stands in the list."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import gpu
from bpy.props import StringProperty
from gpu_extras.batch import batch_for_shader

from ..choice import operators_selection, picture_clicks
from ..choice.click_files import FOLDER, clicks_text, outlined_in
from ..formats.drive_files import read_drive
from ..formats.files import own_folder, write_whole
from ..formats.sequences import pictures_in
from ..formats.timeline import timeline_of
from ..scene import cameras, view
from .job.job_operator import JobOperator, UserError
from .job.task import Task
from .operators_run import workspace_of

__all__ = ["list_outlined"]

INSIDE, OUTSIDE, DOT_PX = (0.2, 0.9, 0.35, 1.0), (1.0, 0.25, 0.15, 1.0), 9.0
HELP = "Click on the object, Ctrl-click beside it · Enter outlines it in all frames · Backspace takes one back · Esc"


class UNVEIL_OT_outline_object(JobOperator, bpy.types.Operator):
    """Click on something in this frame, and it is outlined in all frames and can be removed"""

    bl_idname = "unveil.outline_object"
    bl_label = "Outline by Clicks"
    bl_options = {"REGISTER"}

    class_name: StringProperty(name="Name", default="object", description="Name of the object in the list")
    inside: StringProperty(
        name="On it", description="Places on the object as X,Y; X,Y: shares of the picture from its upper left corner"
    )
    outside: StringProperty(name="Beside it", description="Places that are not the object, likewise")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if view.shown_drive(context.scene) is None or cameras.track_of(context.scene.camera) is None:
            cls.poll_message_set("Import a drive first, and look through a camera of it")
            return False
        return super().poll(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        space = context.space_data
        if context.region_data is None or space is None or space.region_3d.view_perspective != "CAMERA":
            self.report({"ERROR"}, "Look through a camera of the drive first (Numpad 0)")
            return {"CANCELLED"}
        self._clicks: list[tuple[tuple[float, float], tuple[int, int], bool]] = []
        self._drawn = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        context.workspace.status_text_set(HELP)
        context.window_manager.modal_handler_add(self)
        context.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.area.tag_redraw()
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self._ended(context, {"CANCELLED"})
        if event.type in {"RET", "NUMPAD_ENTER"} and event.value == "PRESS":
            self.inside = _text(share for share, _, other in self._clicks if not other)
            self.outside = _text(share for share, _, other in self._clicks if other)
            self._ended(context, {"FINISHED"})
            return self.start_following(context)
        if event.type == "BACK_SPACE" and event.value == "PRESS" and self._clicks:
            self._clicks.pop()
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            place = (event.mouse_region_x, event.mouse_region_y)
            share = picture_clicks.share_of_picture(context, *place)
            if share is None:
                return {"PASS_THROUGH"}  # a click on the sidebar, or beside the picture
            self._clicks.append((share, place, event.ctrl))
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"}

    def _ended(self, context: bpy.types.Context, how: set[str]) -> set[str]:
        bpy.types.SpaceView3D.draw_handler_remove(self._drawn, "WINDOW")
        context.workspace.status_text_set(None)
        return how

    def _draw(self) -> None:
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        gpu.state.point_size_set(DOT_PX)
        for other, color in ((False, INSIDE), (True, OUTSIDE)):
            dots = [(float(x), float(y), 0.0) for _, (x, y), o in self._clicks if o == other]
            if dots:
                shader.uniform_float("color", color)
                batch_for_shader(shader, "POINTS", {"pos": dots}).draw(shader)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        scene, root = context.scene, workspace_of(context.scene)
        assert root is not None  # its drive is shown
        inside, outside = _places(self.inside), _places(self.outside)
        if not inside:
            raise UserError("Nothing was clicked: click on the object, then press Enter")
        drive, track = read_drive(root), str(cameras.track_of(scene.camera))
        frame = drive.tracks[track][timeline_of(drive, scene.unveil.start_frame).at(track, scene.frame_current)]
        name = self.class_name.strip() or "object"
        folder = own_folder(root, FOLDER)
        write_whole(folder / "asked.json", clicks_text(name, track, frame.name, inside, outside).encode())
        return ["mask", str(root), "--stroke", str(folder / "asked.json"), "-o", str(folder)]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=list_outlined)


def _text(shares: object) -> str:
    return "; ".join(f"{x:.6f},{y:.6f}" for x, y in shares)  # type: ignore[attr-defined]


def _places(text: str) -> list[tuple[float, float]]:
    try:
        pairs = [tuple(float(v) for v in part.split(",")) for part in text.split(";") if part.strip()]
        return [(x, y) for x, y in pairs]
    except ValueError as error:
        raise UserError(f"Places {text!r}: give X,Y; X,Y") from error


def list_outlined(context: bpy.types.Context, workspace: str) -> None:
    """Put the objects that were outlined into the list, those that are there already with their mattes as they are now."""
    scene, root = context.scene, workspace_of(context.scene)
    assert root is not None
    for outlined in outlined_in(root / FOLDER):
        mattes = str(outlined.mattes)
        known = [o for o in scene.unveil_selection.objects if o.source == "mattes" and _same(o.mattes, mattes)]
        thing = known[0] if known else operators_selection.new_entry(scene, outlined.name, "mattes")
        thing.mattes, thing.frames, thing.chosen = mattes, len(pictures_in(mattes)), True


def _same(one: str, other: str) -> bool:
    return Path(bpy.path.abspath(one)).resolve() == Path(other).resolve()


CLASSES = (UNVEIL_OT_outline_object,)
