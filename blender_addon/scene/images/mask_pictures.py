# SPDX-License-Identifier: GPL-3.0-or-later
"""A mask of Blender's mask editor as pictures, by Blender's own compositor: with feather, keys and parents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...formats.open_safely import LARGEST_PICTURE, open_file
from .. import versions

__all__ = ["draw_mask", "painted", "read_picture", "size_of"]

LEAST = 3 / 255
"""A difference of a channel from which a pixel counts as painted: saving rounds by less."""


def draw_mask(mask: bpy.types.Mask, size: tuple[int, int], times: Sequence[int], files: Sequence[Path]) -> None:
    """Write a mask as grey PNGs of 8 bits, white inside.

    Args:
        mask: drawn over pictures of these proportions.
        size: width and height, pixels; times: frames of the timeline.
        files: one for each of them, in folders that are there.
    Raises:
        RuntimeError: Blender cannot render it.
    """
    scene = bpy.data.scenes.new("Unveil mask")
    tree = None
    try:
        tree, result = versions.empty_compositor(scene)
        node = tree.nodes.new("CompositorNodeMask")
        node.mask = mask
        tree.links.new(node.outputs[0], result)
        render, settings = scene.render, scene.render.image_settings
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
        render.use_sequencer, render.use_file_extension = False, False
        scene.view_settings.view_transform = "Raw"  # the numbers as they are
        versions.still_pictures(settings)
        settings.file_format, settings.color_mode, settings.color_depth = "PNG", "BW", "8"
        for time, file in zip(times, files, strict=True):
            scene.frame_set(time)
            render.filepath = str(file)
            bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        own = tree if tree is not None and tree.name in bpy.data.node_groups else None
        bpy.data.scenes.remove(scene)
        if own is not None:
            bpy.data.node_groups.remove(own)


def size_of(file: Path) -> tuple[int, int]:
    """Width and height of a picture, pixels."""
    with read_picture(file) as image:
        return int(image.size[0]), int(image.size[1])


@contextmanager
def read_picture(file: Path) -> Iterator[bpy.types.Image]:
    """A picture in a data block of its own, as long as it is looked at.

    Raises:
        OSError: it is not there, or a link, a pipe or a device. RuntimeError: Blender cannot read it.
    """
    open_file(file, LARGEST_PICTURE).close()
    image = bpy.data.images.load(str(file), check_existing=False)
    try:
        yield image
    finally:
        bpy.data.images.remove(image)


def painted(image: bpy.types.Image, before: Path) -> np.ndarray:
    """(H, W) where a picture was painted over, the first row on top.

    Args:
        image: as it is in Blender's memory; before: the file that it was a copy of.
    Raises:
        ValueError: they are not of one size. OSError: the file cannot be read.
    """
    with read_picture(before) as other:
        other.colorspace_settings.name = image.colorspace_settings.name
        if tuple(other.size) != tuple(image.size):
            raise ValueError(f"{before}: is not of the size of what is painted on (paint this frame's mask again)")
        one, two = _pixels(image), _pixels(other)
    return np.asarray(np.abs(one - two).max(axis=2) > LEAST)


def _pixels(image: bpy.types.Image) -> np.ndarray:
    """(H, W, 3), the first row on top."""
    width, height = image.size
    found = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(found)
    return found.reshape(height, width, image.channels)[::-1, :, :3]
