# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a movie file as numbered PNGs, by Blender's own sequencer in a scene of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from .. import versions
from .camera import ShotError

__all__ = ["extracted"]


def extracted(
    movie: Path, folder: Path, numbers: Sequence[int], frames: Sequence[int], size: tuple[int, int]
) -> list[Path]:
    """Write pictures of a movie, 8-bit PNGs of its own size and colours; what is there of a movie of this time stays.

    Args:
        numbers: of its pictures, from 1; frames: by which the files are named, as ``1001.png``.
    Returns:
        the files.
    Raises:
        ShotError: Blender cannot read the movie.
    """
    files = [folder / f"{frame:04d}.png" for frame in frames]
    newer = movie.stat().st_mtime_ns
    if all(f.is_file() and f.stat().st_mtime_ns >= newer for f in files):
        return files
    folder.mkdir(parents=True, exist_ok=True)
    scene = bpy.data.scenes.new("Unveil movie")
    try:
        _set_up(scene, size)
        try:
            strip = versions.strips_of(scene).new_movie("movie", str(movie), 1, 1)
        except RuntimeError as error:
            raise ShotError(f"{movie}: Blender cannot read it: convert it to a picture sequence") from error
        last = max(numbers)
        if strip.frame_duration < last:
            raise ShotError(
                f"{movie}: has {strip.frame_duration} pictures, and the frame range asks for number {last}: "
                "set the frame range to the clip's, or correct its start frame"
            )
        scene.render.use_overwrite = True
        for number, file in zip(numbers, files, strict=True):
            scene.frame_start = scene.frame_end = number
            scene.frame_set(number)
            scene.render.filepath = str(file)
            bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        bpy.data.scenes.remove(scene)
    lost = next((f for f in files if not f.is_file()), None)
    if lost is not None:
        raise ShotError(f"{movie}: Blender wrote no picture {lost.name} of it: convert it to a picture sequence")
    return files


def _set_up(scene: bpy.types.Scene, size: tuple[int, int]) -> None:
    """A scene whose render is the movie's picture and nothing else."""
    render, colours = scene.render, scene.view_settings
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_sequencer, render.use_compositing, render.dither_intensity = True, False, 0.0
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.image_settings.color_depth = "8"
    scene.display_settings.display_device = "sRGB"
    colours.view_transform, colours.look, colours.exposure, colours.gamma = "Standard", "None", 0.0, 1.0
    scene.sequencer_colorspace_settings.name = "sRGB"
