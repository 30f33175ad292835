# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of pictures that artists paint on: what is painted is saved into the copy alone, whatever a .blend says of the picture."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy

from ...formats.files import make_own
from ...formats.open_safely import LARGEST_PICTURE, read_bytes
from .. import blocks
from .mask_pictures import read_picture

__all__ = ["as_png", "copy_to_paint", "has_unsaved", "save_copy"]


def copy_to_paint(drive: str, role: str, path: Path, name: str) -> bpy.types.Image:
    """The picture of that role, of this file and no other: also Blender's own *Save* writes there alone.

    Raises:
        OSError: the file is not there, or none of its own can be made of it.
    """
    make_own(path)
    image = blocks.ensure_file(bpy.data.images, drive, role, str(path), name)
    # Each is set only where it differs: Blender forgets what was painted.
    if image.source != "FILE":
        image.source = "FILE"
    if image.use_multiview:  # files of other names would be written
        image.use_multiview = False
    own = blocks.as_preferred(str(path))
    if image.filepath != own:  # one that is written in another way may lead elsewhere
        image.filepath_raw = own
    if not has_unsaved(image):
        image.reload()
    return image


def has_unsaved(image: bpy.types.Image) -> bool:
    """Whether an image holds what is in no file: painted since it was saved, or packed into the .blend."""
    return bool(image.is_dirty or image.packed_file is not None)


def save_copy(image: bpy.types.Image, path: Path) -> None:
    """Save an image into its copy.

    Raises:
        OSError: the copy is not there, or none of its own can be made of it.
        ValueError: the image cannot be saved; one line.
    """
    make_own(path)
    if image.source != "FILE" or image.use_multiview:
        raise ValueError(f"{image.name}: Not a single picture (save it by hand as {path})")
    try:
        image.save(filepath=str(path))
    except RuntimeError as error:
        raise ValueError(f"{path}: Not saved: {error}") from error


def as_png(photograph: Path) -> bytes:
    """A picture of a kind that Blender reads as a PNG, by way of a file that nobody else reads.

    Raises:
        OSError: it cannot be read, or not written anew. RuntimeError: it is no picture.
    """
    with tempfile.TemporaryDirectory(prefix="unveil-") as folder, read_picture(photograph) as image:
        image.update()  # it is read now: before, there is nothing to save, and it has the kind of its file
        image.file_format = "PNG"
        made = Path(folder) / "picture.png"
        image.save(filepath=str(made), save_copy=True)
        return read_bytes(made, LARGEST_PICTURE)
