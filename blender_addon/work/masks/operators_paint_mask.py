# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint over an object in a copy of a photograph, in any colour: what is painted over becomes an object that goes."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty

from ...choice.operators_fixes import show_picture
from ...choice.painted_files import BEFORE, begin_copy, is_painted
from ...formats.drive_files import DriveFrame
from ...formats.files import one_line, write_whole
from ...formats.open_safely import LARGEST_PICTURE, read_bytes
from ...formats.sequences import SIGNATURE
from ...formats.writing.new_files import new_files
from ...scene import blocks, view
from ...scene.images.mask_pictures import painted
from ...scene.images.painted_copies import as_png, copy_to_paint, has_unsaved
from ..job.job_operator import UserError
from .grey_png import grey_png
from .mask_job import MaskJob, Shown, carried, has_frames, shown_frames

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
            collection = view.shown_drive(context.scene)
            mark = "" if collection is None else blocks.drive_of(collection)
            role = f"{ROLE}{shown.track}:{frame.name}"
            known = blocks.find(bpy.data.images, mark, role)
            if not (known is not None and has_unsaved(known)) and not is_painted(folder, frame.name):
                content = read_bytes(frame.footage, LARGEST_PICTURE)
                content = content if content.startswith(SIGNATURE) else as_png(frame.footage)
                begin_copy(folder, frame.name, content, like=frame.footage)
            image = copy_to_paint(mark, role, folder / f"{frame.name}.png", f"Mask {shown.track} {frame.name}")
        except (OSError, ValueError, RuntimeError, UserError) as error:
            self.report({"ERROR"}, one_line(error, Path(context.scene.unveil.workspace)))
            return {"CANCELLED"}
        if not bpy.app.background and context.window_manager.windows:
            show_picture(context, image)
        return {"FINISHED"}


class UNVEIL_OT_use_painted(MaskJob, bpy.types.Operator):
    """Take what was painted over for an object that goes, and find it in all other frames"""

    bl_idname = "unveil.use_painted"
    bl_label = "Use Painted Mask"

    class_name: StringProperty(name="Name", default="object", description="Name of the object in the list")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        shown = shown_frames(context.scene)
        folder = shown.folder(PAINTED)
        frame, image = _painted_on(context, shown)
        where = painted(image, folder / f"{frame.name}{BEFORE}.png")
        if not where.any():
            raise UserError("Nothing was painted: paint over the object in the Image Editor, then press this again")
        name = f"{frame.name}.png"
        with new_files(shown.folder(f"{PAINTED}_mattes"), ("*.png",), whole=False, mend="move it") as files:
            matte = grey_png(np.where(where, 255, 0).astype(np.uint8))
            write_whole(files.path(name), matte, like=frame.footage)
        told = f"{shown.track}/{frame.name}:{files.folder / name}"
        return carried(shown.root, self.class_name.strip() or "object", "--matte", told)


def _painted_on(context: bpy.types.Context, shown: Shown) -> tuple[DriveFrame, bpy.types.Image]:
    """The frame and its copy: the one that is looked at, else that of the frame that is shown, else the only one.

    Raises:
        UserError: there is none.
    """
    collection = view.shown_drive(context.scene)
    drive = "" if collection is None else blocks.drive_of(collection)
    # Of the drive's own frames alone: names become those of files, and a .blend says any.
    roles = {f"{ROLE}{shown.track}:{frame.name}": frame for frame in shown.frames}
    copies = [(roles[role], i) for i in bpy.data.images if (role := i.get(blocks.ROLE)) in roles]
    copies = [(frame, i) for frame, i in copies if i.get(blocks.DRIVE) == drive]
    looked_at = getattr(context.space_data, "image", None)
    now = shown.frames[shown.now]
    found = next((c for c in copies if c[1] == looked_at), None) or next((c for c in copies if c[0] == now), None)
    if found is None:
        raise UserError("No mask of this frame was painted: press Paint Mask, and paint over the object")
    return found


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
