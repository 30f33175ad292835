# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures behind the camera: the photographs, the clean frames, masks and regions, one of them shown at a time."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import bpy

from ...formats.files import files_stamp
from ...formats.sequences import PictureSequence, number_of
from .. import blocks

__all__ = ["KINDS", "files_of", "kinds_of", "reload_changed", "set_color_space", "set_plate", "show_plate"]

KINDS: tuple[tuple[str, str, str], ...] = (
    ("original", "Photographs", "The drive's own pictures"),
    ("clean", "Clean Frames", "The delivery: the empty street where something was removed"),
    ("preview", "Preview", "The frames that were tried at draft quality"),
    ("kept", "Kept Version", "A result that was kept, to compare later ones with"),
    ("render", "Empty Scene", "The empty 3D scene, rendered"),
    ("inpainted", "Inpainted", "What was inpainted in the keyframes, carried to all frames"),
    ("regions", "Regions", "Blue: seen here, green: seen from other views, red: never seen"),
    ("provenance", "Origins", "Blue: relit, green: seen in other frames, yellow: continued from beside, red: made up"),
    ("removed", "Removed", "Mask of removed objects"),
    ("shadows", "Shadows", "Mask of shadows that are removed with them"),
    ("unobserved", "Unobserved", "Mask of what no frame has seen"),
)
"""(identifier, name, description) of every kind of plate."""


MASKS = ("removed", "shadows", "unobserved")
"""Kinds whose values are numbers rather than colours."""


def set_plate(
    camera: bpy.types.Object, drive: str, kind: str, pictures: PictureSequence, start: int
) -> bpy.types.Image:
    """Put a sequence behind a track's camera, hidden; brought up to date where it is there already.

    Args:
        start: frame of the timeline of its first picture.
    """
    track = camera["unveil_track"]
    role = f"plate:{kind}:{track}"
    image = blocks.ensure_file(bpy.data.images, drive, role, str(pictures.files[0]), f"{track} {kind}")
    set_color_space(image, kind)
    image.source = "SEQUENCE" if len(pictures) > 1 else "FILE"
    reload_changed(image, pictures.files)
    backgrounds = camera.data.background_images
    plate = next((b for b in backgrounds if b.image == image), None)
    if plate is None:
        plate = backgrounds.new()
        # All kinds show what the camera does, masks by fewer pixels: their sides need not be exactly as long to each other.
        plate.image, plate.alpha, plate.display_depth, plate.frame_method = image, 1.0, "BACK", "STRETCH"
        plate.show_background_image = plate.show_expanded = False
    user = plate.image_user
    user.frame_start, user.frame_duration, user.frame_offset = start, len(pictures), pictures.first - 1
    user.use_auto_refresh = True
    camera.data.show_background_images = True
    return image


def reload_changed(image: bpy.types.Image, files: Iterable[Path]) -> None:
    """Let Blender forget what it has read of a picture's files where one was written anew since this was last asked."""
    stamp = files_stamp(files)
    if image.get("unveil_stamp") != stamp:
        image.reload()
        image["unveil_stamp"] = stamp


def set_color_space(image: bpy.types.Image | bpy.types.MovieClip, kind: str) -> None:
    """Masks are no colours, whatever the configuration calls that; all else keeps what the configuration gives its kind of file."""
    if kind in MASKS and not image.colorspace_settings.is_data:
        image.colorspace_settings.is_data = True


def kinds_of(camera: bpy.types.Object) -> list[str]:
    """The kinds of plates that a camera has."""
    roles = [str(b.image.get(blocks.ROLE, "")) for b in camera.data.background_images if b.image is not None]
    found = {r.split(":")[1] for r in roles if r.startswith("plate:")}
    return [kind for kind, _, _ in KINDS if kind in found]


def show_plate(camera: bpy.types.Object, kind: str) -> None:
    """Show one kind of plate behind a camera, the photographs where it has not that one, none for ``"none"``."""
    wanted = kind if kind == "none" or kind in kinds_of(camera) else "original"
    for plate in camera.data.background_images:
        if plate.image is not None and str(plate.image.get(blocks.ROLE, "")).startswith("plate:"):
            plate.show_background_image = plate.image[blocks.ROLE].split(":")[1] == wanted


def files_of(camera: bpy.types.Object, kind: str) -> list[str]:
    """The files of one kind of plate, in order; empty where the camera has not that one."""
    for plate in camera.data.background_images:
        if plate.image is not None and plate.image.get(blocks.ROLE) == f"plate:{kind}:{camera['unveil_track']}":
            first = bpy.path.abspath(plate.image.filepath)
            folder, name = os.path.split(first)
            stem, suffix = os.path.splitext(name)
            digits = number_of(stem)
            begin = stem[: -len(digits)] if digits else stem
            numbers = range(int(digits), int(digits) + plate.image_user.frame_duration)
            return [os.path.join(folder, f"{begin}{n:0{len(digits)}d}{suffix}") for n in numbers]
    return []
