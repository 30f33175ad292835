# SPDX-License-Identifier: GPL-3.0-or-later
"""A mask of Blender's mask editor becomes an object that goes: drawn on one frame, or animated over all."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, StringProperty

from ...formats.drive_files import file_name
from ...formats.files import readable_as
from ...formats.writing.new_files import new_files
from ...scene.images.mask_pictures import draw_mask, size_of
from ..job.job_operator import UserError
from .mask_job import MaskJob, carried, shown_frames

__all__: list[str] = []

MASKS = "masks"
"""Beside what artists paint: a mask may have any name."""


class UNVEIL_OT_use_mask(MaskJob, bpy.types.Operator):
    """Take what a mask of the mask editor is drawn around for an object that goes"""

    bl_idname = "unveil.use_mask"
    bl_label = "Use Mask"

    mask: StringProperty(name="Mask", description="Name of a mask; empty: the one that is edited, or the only one")
    animated: BoolProperty(
        name="All Frames",
        description="The mask follows the object in all frames; off: it counts in this frame, and the others follow by the scene",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        edited = getattr(context.space_data, "mask", None)
        if edited is not None and not self.mask:
            self.mask = edited.name
        self.animated = self.animated or _is_animated(_mask_of(self.mask))
        return super().invoke(context, event)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        mask = _mask_of(self.mask)
        if mask is None:
            named = f"Not found: the mask {self.mask}" if self.mask else "No mask to take, or more than one"
            raise UserError(f"{named}: draw one in the Movie Clip Editor or Image Editor, mode Mask")
        if not any(len(spline.points) > 2 for layer in mask.layers for spline in layer.splines):
            raise UserError(f"The mask {mask.name} is empty: draw around the object, and close the spline")
        shown = shown_frames(context.scene)
        folder = shown.folder(MASKS, file_name(bpy.path.clean_name(mask.name)))
        chosen = range(len(shown.frames)) if self.animated else [shown.now]
        frames = [shown.frames[i] for i in chosen]
        size = size_of(shown.frames[0].footage)
        # Frames of a mask that is not animated any more go.
        with new_files(folder, ("*.png",), mend="move it, or give the mask another name") as files:
            drawn = [files.path(f"{frame.name}.png") for frame in frames]
            try:
                draw_mask(mask, size, [shown.times[i] for i in chosen], drawn)
            except RuntimeError as error:
                raise UserError(f"The mask {mask.name} cannot be drawn: {error}") from error
            for file, frame in zip(drawn, frames, strict=True):
                readable_as(file, frame.footage)
        return carried(shown.root, mask.name, "--mattes", str(folder.parent))


def _mask_of(name: str) -> bpy.types.Mask | None:
    """The mask of a name; without one, the only one."""
    if name:
        return bpy.data.masks.get(name)
    return bpy.data.masks[0] if len(bpy.data.masks) == 1 else None


def _is_animated(mask: bpy.types.Mask | None) -> bool:
    """Whether a mask has keys, or a point of it follows a track."""
    if mask is None:
        return False
    parented = any(p.parent.parent for layer in mask.layers for s in layer.splines for p in s.points)
    return parented or (mask.animation_data is not None and mask.animation_data.action is not None) or _has_keys(mask)


def _has_keys(mask: bpy.types.Mask) -> bool:
    """Whether shapes are keyed: Blender shows these to no script, but where they are, the points move."""
    scene = bpy.context.scene
    now = scene.frame_current
    places = []
    try:
        for frame in (scene.frame_start, (scene.frame_start + scene.frame_end) // 2, scene.frame_end):
            scene.frame_set(frame)
            points = (p for layer in mask.layers for spline in layer.splines for p in spline.points)
            places.append([tuple(p.co) for p in points])
    finally:
        scene.frame_set(now)
    return any(place != places[0] for place in places)


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator(UNVEIL_OT_use_mask.bl_idname, text="Remove with Unveil", icon="MOD_MASK")


CLASSES = (UNVEIL_OT_use_mask,)


def register() -> None:
    bpy.types.MASK_MT_mask.append(_menu)


def unregister() -> None:
    bpy.types.MASK_MT_mask.remove(_menu)
