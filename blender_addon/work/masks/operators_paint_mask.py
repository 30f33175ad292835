# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint over an object in a copy of a photograph, in any colour: what is painted over becomes an object that goes."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty

from ...choice.operators_fixes import show_picture
from ...choice.painted_files import BEFORE, is_painted
from ...formats.files import one_line, write_whole
from ...formats.open_safely import LARGEST_PICTURE, read_bytes
from ...formats.sequences import SIGNATURE
from ...scene import blocks, view
from ...scene.images.mask_pictures import painted
from ..job.job_operator import UserError
from .grey_png import grey_png
from .mask_job import MaskJob, carried, has_frames, shown_frames

__all__ = ["ROLE"]

ROLE = "mask:"
"""Begins the role of the copies."""
PAINTED = "painted"


class UNVEIL_OT_paint_mask(bpy.types.Operator):
    """Paint over an object in a copy of this photograph; what is painted over goes, in all frames"""

    bl_idname = "unveil.paint_mask"
    bl_label = "Paint Mask"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_frames(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            shown = shown_frames(context.scene)
            frame, folder = shown.frames[shown.now], shown.folder(PAINTED)
            copy = folder / f"{frame.name}.png"
            collection = view.shown_drive(context.scene)
            mark = "" if collection is None else blocks.drive_of(collection)
            role = f"{ROLE}{shown.track}:{frame.name}"
            if blocks.find(bpy.data.images, mark, role) is None and not is_painted(folder, frame.name):
                content = _as_png(frame.footage, folder / f"{frame.name}{BEFORE}.png")
                for name in (frame.name, frame.name + BEFORE):
                    write_whole(folder / f"{name}.png", content, like=frame.footage)
            image = blocks.ensure_file(bpy.data.images, mark, role, str(copy), f"Mask {shown.track} {frame.name}")
        except (OSError, ValueError, RuntimeError, UserError) as error:
            self.report({"ERROR"}, one_line(error, Path(context.scene.unveil.workspace)))
            return {"CANCELLED"}
        if not bpy.app.background and context.window_manager.windows:
            show_picture(context, image)
        return {"FINISHED"}


def _as_png(photograph: Path, place: Path) -> bytes:
    """A photograph as a PNG, in which painting and saving changes nothing else.

    Args:
        place: where it may be written.
    """
    content = read_bytes(photograph, LARGEST_PICTURE)
    if content.startswith(SIGNATURE):
        return content
    image = bpy.data.images.load(str(photograph), check_existing=False)
    try:
        image.file_format, image.filepath_raw = "PNG", str(place)
        image.save()
    finally:
        bpy.data.images.remove(image)
    return read_bytes(place, LARGEST_PICTURE)


class UNVEIL_OT_use_painted(MaskJob, bpy.types.Operator):
    """Take what was painted over for an object that goes, and find it in all other frames"""

    bl_idname = "unveil.use_painted"
    bl_label = "Use Painted Mask"

    class_name: StringProperty(name="Name", default="object", description="Name of the object in the list")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        shown = shown_frames(context.scene)
        folder = shown.folder(PAINTED)
        frame, image = _painted_on(context, shown.track)
        try:
            where = painted(image, folder / f"{frame}{BEFORE}.png")
        except ValueError as error:
            raise UserError(str(error)) from error
        if not where.any():
            raise UserError("Nothing was painted: paint over the object in the Image Editor, then press this again")
        matte = shown.folder(f"{PAINTED}_mattes") / f"{frame}.png"
        write_whole(matte, grey_png(np.where(where, 255, 0).astype(np.uint8)))
        return carried(shown.root, self.class_name.strip() or "object", "--matte", f"{shown.track}/{frame}:{matte}")


def _painted_on(context: bpy.types.Context, track: str) -> tuple[str, bpy.types.Image]:
    """Name of the frame and its copy: the one that is looked at, else that of the frame that is shown, else the only one.

    Raises:
        UserError: there is none.
    """
    collection = view.shown_drive(context.scene)
    begins, drive = f"{ROLE}{track}:", "" if collection is None else blocks.drive_of(collection)
    copies = {
        str(i[blocks.ROLE]).removeprefix(begins): i
        for i in bpy.data.images
        if i.get(blocks.DRIVE) == drive and str(i.get(blocks.ROLE, "")).startswith(begins)
    }
    looked_at = getattr(context.space_data, "image", None)
    shown = shown_frames(context.scene)
    for frame, image in copies.items():
        if image == looked_at:
            return frame, image
    name = shown.frames[shown.now].name
    if name not in copies:
        raise UserError("No mask of this frame was painted: press Paint Mask, and paint over the object")
    return name, copies[name]


def _header(self: bpy.types.Header, context: bpy.types.Context) -> None:
    """What to do with a painted copy stands over it."""
    image = getattr(context.space_data, "image", None)
    if image is not None and str(image.get(blocks.ROLE, "")).startswith(ROLE):
        self.layout.operator(UNVEIL_OT_use_painted.bl_idname, icon="CHECKMARK")


CLASSES = (UNVEIL_OT_paint_mask, UNVEIL_OT_use_painted)


def register() -> None:
    bpy.types.IMAGE_HT_header.append(_header)


def unregister() -> None:
    bpy.types.IMAGE_HT_header.remove(_header)
