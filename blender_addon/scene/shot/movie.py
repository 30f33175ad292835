# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a movie file as numbered PNGs, by Blender's own sequencer in a scene of its own."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import bpy

from ...formats.files import file_stamp, readable_as
from ...formats.writing.new_files import NewFiles
from .. import versions
from .camera import ShotError

__all__ = ["extracted"]


def extracted(movie: Path, drive: NewFiles, frames: Sequence[int], shift: int, size: tuple[int, int]) -> list[Path]:
    """Write pictures of a movie, 8-bit PNGs of its own size and colours; those of this movie that are there stay.

    Args:
        drive: that they are part of.
        frames: of the timeline, one after the other, by which the files are named, as ``1001.png``.
        shift: number of the movie's picture, from 1, less the frame that shows it.
    Returns:
        the files, which are there once all files of the drive have their names.
    Raises:
        ShotError: Blender cannot read the movie. OSError: a picture cannot be written.
    """
    names = [f"images/{frame:04d}.png" for frame in frames]
    files = [drive.folder / name for name in names]
    made_of = f"{movie} {file_stamp(movie)} {shift} {size}"
    of, drive.of = drive.of, hashlib.sha256(made_of.encode(errors="surrogateescape")).hexdigest()[:32]
    if drive.of == of and all(name in drive.before for name in names):
        drive.keep(*names)
        return files
    made = [drive.path(name) for name in names]
    scene = bpy.data.scenes.new("Unveil movie")
    try:
        _set_up(scene, size)
        try:
            strip = versions.strips_of(scene).new_movie("movie", str(movie), 1, 1 - shift)
        except RuntimeError as error:
            raise ShotError(f"{movie}: Blender cannot read it: convert it to a picture sequence") from error
        if strip.fps > 0:  # else pictures would be left out or doubled, to keep pace with the scene
            scene.render.fps = max(round(strip.fps), 1)
            scene.render.fps_base = scene.render.fps / strip.fps
        last = frames[-1] + shift
        length = versions.content_length(strip)
        if length < last:
            raise ShotError(
                f"{movie}: has {length} pictures, and the frame range asks for number {last}: "
                "set the frame range to the clip's, or correct its start frame"
            )
        # One picture after the other as Blender plays them: what is asked for by itself may be the one shown before.
        scene.frame_start, scene.frame_end = frames[0], frames[-1]
        scene.render.use_overwrite, scene.render.filepath = True, str(made[0].with_name("####"))
        bpy.ops.render.render(animation=True, scene=scene.name)
    finally:
        bpy.data.scenes.remove(scene)
    lost = next((f for f in made if not f.is_file()), None)
    if lost is not None:
        raise ShotError(f"{movie}: Blender wrote no picture {lost.name} of it: convert it to a picture sequence")
    for file in made:
        readable_as(file, movie)
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
