# SPDX-License-Identifier: GPL-3.0-or-later
"""The shot of a scene: its active camera over the frame range, the plates behind it and the points that are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...formats.shot.writer import Shot, ShotFrame
from ...formats.writing.new_files import NewFiles
from ..drive_scene import metre_of
from . import points
from .background import Background, background_of
from .camera import CameraAt, ShotError, check_camera, sampled
from .movie import extracted

__all__ = ["Taken", "shot_of"]

STANDS = 1e-6
"""Change of a pose's numbers in all frames below which a camera does not move."""
NAMED = 3
"""Frames without a plate that a line names."""


@dataclass(frozen=True, eq=False)
class Taken:
    """Attributes:
    shot: what is written.
    told: what the artist should know of it, one line each.
    """

    shot: Shot
    told: tuple[str, ...]


def shot_of(context: bpy.types.Context, drive: NewFiles) -> Taken:
    """The shot of the scene as it is.

    Args:
        drive: that it becomes, with the pictures of a movie.
    Raises:
        ShotError: the camera, the plates or their lens cannot be used.
        OSError: a picture of a movie cannot be written.
    """
    scene = context.scene
    if scene.camera is None:
        check_camera(scene, (1, 1))
    background = background_of(scene, scene.camera)
    camera = check_camera(scene, background.size)
    if camera.get("unveil_track"):
        raise ShotError(f"{camera.name} is a camera of a drive that was imported: choose the shot's own camera")
    frames = range(scene.frame_start, scene.frame_end + 1)
    metre = metre_of(scene)
    # A camera that cannot be used is told before minutes of work on a movie's frames.
    cameras = dict(zip(frames, sampled(scene, camera, frames, background.size), strict=True))
    pictures, told = _pictures(background, frames, drive)
    seen = [cameras[frame] for frame in pictures]
    bent = background.distortion(seen[0].focal[0])
    if any(bent) and max(abs(c.focal[0] / seen[0].focal[0] - 1) for c in seen) > 1e-4:
        raise ShotError(
            f"{camera.name} zooms, and the clip's lens distortion is of one focal length: undistort the plates"
        )
    if len(seen) > 1 and max(float(np.abs(c.to_world - seen[0].to_world).max()) for c in seen) < STANDS:
        told.append(
            f"{camera.name} stands still in these frames: check the frame range, and the frame rate it was imported with"
        )
    known = _points(context, scene, camera, background, frames)
    if not len(known):
        told.append(
            "No points are known: solve the clip, or select the locators or the mesh of the street, for a better scene"
        )
    rate = scene.render.fps / scene.render.fps_base
    numbered = [_frame(n, file, at, metre) for (n, file), at in zip(pictures.items(), seen, strict=True)]
    return Taken(Shot(camera.name, background.size, rate, tuple(numbered), bent, known / metre), tuple(told))


def _frame(number: int, picture: Path, at: CameraAt, metre: float) -> ShotFrame:
    placed = at.to_world.copy()
    placed[:3, 3] /= metre
    return ShotFrame(number, picture, placed, at.focal, at.centre)


def _pictures(background: Background, frames: range, drive: NewFiles) -> tuple[dict[int, Path], list[str]]:
    """The plate of each frame that has one, and what is to be said of the others."""
    plates = background.plates
    if background.is_movie:
        inside = [f for f in frames if f + plates.shift >= 1 and (plates.span is None or f <= plates.span[1])]
        if not inside:
            raise ShotError(
                f"{background.name} shows nothing in frames {frames[0]} to {frames[-1]}: set the frame range"
            )
        files = extracted(plates.first, drive, inside, plates.shift, background.size)
        return dict(zip(inside, files, strict=True)), []
    found = {f: file for f in frames if (file := plates.file(f)) is not None and file.is_file()}
    if not found:
        asked = plates.file(frames[0])
        raise ShotError(
            f"No frame of {frames[0]} to {frames[-1]} has a plate of {background.name}, frame {frames[0]} would be "
            f"{asked.name if asked else 'before the first'}: set the frame range, or the start frame of the clip or image"
        )
    missing = [f for f in frames if f not in found]
    if not missing:
        return found, []
    named = ", ".join(map(str, missing[:NAMED])) + f" and {len(missing) - NAMED} more" * (len(missing) > NAMED)
    return found, [f"{len(missing)} of {len(frames)} frames have no plate and are left out: {named}"]


def _points(
    context: bpy.types.Context,
    scene: bpy.types.Scene,
    camera: bpy.types.Object,
    background: Background,
    frames: range,
) -> np.ndarray:
    """(P, 3) all that are known, units of the scene."""
    clip = background.clip or scene.active_clip
    tracked = np.zeros((0, 3)) if clip is None else points.bundles(scene, camera, clip, frames)
    return np.concatenate([tracked, points.selected(context)])
