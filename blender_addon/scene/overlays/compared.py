# SPDX-License-Identifier: GPL-3.0-or-later
"""Which two pictures of a camera's present frame are compared, as data blocks of this file that hold no more than these.

Blender gives a sequence's texture of whatever frame it has drawn last; so each picture is put into a block of its own as the frame
changes, not while a view is drawn.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ...formats.open_safely import LARGEST_PICTURE, open_file
from .. import cameras, view
from ..images import plates

__all__ = ["kinds_compared", "pictures_compared", "put_in"]

SIDES = ("Unveil Compare A", "Unveil Compare B")
"""Names of the blocks; neither is saved with the file, for nothing uses them."""


def kinds_compared(scene: bpy.types.Scene) -> tuple[str, str] | None:
    """What is shown and what it is compared with, as kinds of plates; None where nothing is compared."""
    shown, camera = scene.unveil_view, scene.camera
    if shown.compare == "NONE" or cameras.track_of(camera) is None:
        return None
    there = plates.kinds_of(camera)
    front = shown.background if shown.background in there else "original"
    other = "provenance" if shown.compare == "ORIGIN" else shown.compare_with
    return (front, other) if other in there else None


def file_at(camera: bpy.types.Object, kind: str, frame: int) -> str:
    """The file of a kind of plate at a frame of the timeline, the first or last beyond its ends; empty where there is none."""
    files = plates.files_of(camera, kind)
    if not files:
        return ""
    role = f"plate:{kind}:{camera['unveil_track']}"
    user = next(b.image_user for b in camera.data.background_images if b.image and b.image.get("unveil_role") == role)
    return files[min(max(frame - user.frame_start, 0), len(files) - 1)]


def pictures_compared(scene: bpy.types.Scene) -> tuple[Any, Any] | None:
    """The two images, None where nothing is compared, or one could not be read."""
    if kinds_compared(scene) is None:
        return None
    found = tuple(bpy.data.images.get(name) for name in SIDES)
    return found if all(i is not None and i.size[0] for i in found) else None  # type: ignore[return-value]


def put_in(scene: bpy.types.Scene) -> None:
    """Bring the two images in line with the frame; called as frames change and settings do."""
    kinds = kinds_compared(scene)
    if kinds is None:
        return
    for name, kind in zip(SIDES, kinds, strict=True):
        file = file_at(scene.camera, kind, scene.frame_current)
        image = bpy.data.images.get(name)
        try:
            open_file(file, LARGEST_PICTURE).close()
        except (OSError, ValueError):
            if image is not None:
                bpy.data.images.remove(image)
            continue
        if image is None:
            image = bpy.data.images.load(file, check_existing=False)
            image.name = name
            continue
        if image.filepath != file:
            image.filepath = file
            image.reload()


@persistent
def _frame_changed(scene: bpy.types.Scene, *_: object) -> None:
    put_in(scene)


def register() -> None:
    bpy.app.handlers.frame_change_post.append(_frame_changed)
    view.when_changed.append(put_in)


def unregister() -> None:
    view.when_changed.remove(put_in)
    if _frame_changed in bpy.app.handlers.frame_change_post:
        bpy.app.handlers.frame_change_post.remove(_frame_changed)
