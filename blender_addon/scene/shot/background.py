# SPDX-License-Identifier: GPL-3.0-or-later
"""The plates behind a camera: its background clip or image, else the scene's active clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...formats.shot.lens import ClipLensError, opencv_of_clip
from ...formats.shot.numbering import Plates, clip_plates, image_plates, number_in
from .. import blocks
from .camera import ShotError

__all__ = ["Background", "background_of", "put_behind"]

ADD_ONE = "add the plates under Camera > Background Images, as a movie clip or an image sequence"
LENS = (
    "k1", "k2", "k3", "division_k1", "division_k2", "nuke_k1", "nuke_k2", "brown_k1", "brown_k2", "brown_k3", "brown_k4",
    "brown_p1", "brown_p2",
)  # fmt: skip
"""Numbers of a clip's lens that some Blender has."""


@dataclass(frozen=True, eq=False)
class Background:
    """Attributes:
    name: of the clip or image.
    size: pixels.
    plates: which file is shown when; of a movie the file itself.
    clip: the movie clip, None for an image.
    is_movie: one file holds all pictures.
    """

    name: str
    size: tuple[int, int]
    plates: Plates
    clip: bpy.types.MovieClip | None = None
    is_movie: bool = False

    def distortion(self, focal: float) -> tuple[float, ...]:
        """k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV, for a camera of this focal length in pixels.

        Raises:
            ShotError: the clip's lens is of a kind that is not read.
        """
        if self.clip is None:
            return opencv_of_clip("POLYNOMIAL", dict.fromkeys(("k1", "k2", "k3"), 0.0))
        lens = self.clip.tracking.camera
        numbers = {name: float(getattr(lens, name, 0.0)) for name in LENS}
        own = float(lens.focal_length_pixels)
        try:
            return opencv_of_clip(str(lens.distortion_model), numbers, focal / own if own > 0 else 1.0)
        except ClipLensError as error:
            raise ShotError(str(error)) from error


def put_behind(scene: bpy.types.Scene, camera: bpy.types.Object, first: Path, count: int, start: int) -> None:
    """Put a picture sequence behind a camera, and give the scene its size and frame range.

    Args:
        first: its first file; count: numbers from the first file's to the last's.
        start: frame of the timeline that shows the first.
    Raises:
        ShotError: the file has no number, or cannot be read.
    """
    number, size = number_in(first), _size_of(first)
    if number is None:
        raise ShotError(f"{first}: has no number in its name: give a picture of a sequence, as plate.1001.exr")
    _check(first.name, first, size)
    plate = camera.data.background_images.new()
    plate.image = bpy.data.images.load(str(first))
    plate.image.source = "SEQUENCE"
    user = plate.image_user
    user.frame_start, user.frame_duration, user.frame_offset = start, count, number - 1
    camera.data.show_background_images = True
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.frame_start, scene.frame_end = start, start + count - 1


def background_of(scene: bpy.types.Scene, camera: bpy.types.Object) -> Background:
    """The plates behind a camera.

    Raises:
        ShotError: there are none, or they cannot be read.
    """
    shown = sorted(camera.data.background_images, key=lambda b: not b.show_background_image)
    for one in shown:
        clip = scene.active_clip if one.use_camera_clip else one.clip
        if one.source == "MOVIE_CLIP" and clip is not None and not clip.get(blocks.ROLE):
            return _of_clip(clip)
        if one.source == "IMAGE" and one.image is not None and not one.image.get(blocks.ROLE):
            return _of_image(one.image, one.image_user)
    if scene.active_clip is not None and not scene.active_clip.get(blocks.ROLE):
        return _of_clip(scene.active_clip)
    raise ShotError(f"{camera.name} has no pictures behind it: {ADD_ONE}")


def _of_clip(clip: bpy.types.MovieClip) -> Background:
    first, size = blocks.absolute(clip.filepath), (int(clip.size[0]), int(clip.size[1]))
    _check(clip.name, first, size)
    if clip.source == "MOVIE":
        plates = Plates(first, 1 - clip.frame_start + clip.frame_offset, still=True)
        return Background(clip.name, size, plates, clip, is_movie=True)
    return Background(clip.name, size, clip_plates(first, clip.frame_start, clip.frame_offset), clip)


def _of_image(image: bpy.types.Image, user: bpy.types.ImageUser) -> Background:
    if image.source not in ("SEQUENCE", "MOVIE"):
        raise ShotError(
            f"{image.name} is one picture ({image.source.lower()}): {ADD_ONE}, or set its source to Image Sequence"
        )
    first = blocks.absolute(image.filepath)
    if image.source == "MOVIE":
        size = (int(image.size[0]), int(image.size[1]))
        _check(image.name, first, size)
        shift = 1 - user.frame_start + user.frame_offset
        span = (user.frame_start, user.frame_start + max(user.frame_duration, 1) - 1)
        return Background(image.name, size, Plates(first, shift, span, still=True), None, is_movie=True)
    plates = image_plates(first, user.frame_start, user.frame_duration, user.frame_offset)
    size = _size_of(first)
    _check(image.name, first, size)
    return Background(image.name, size, plates)


def _size_of(file: Path) -> tuple[int, int]:
    """Of a picture, pixels; a sequence itself has none before it is drawn."""
    try:
        image = bpy.data.images.load(str(file), check_existing=False)
    except RuntimeError:
        return 0, 0
    size = int(image.size[0]), int(image.size[1])
    bpy.data.images.remove(image)
    return size


def _check(name: str, file: Path, size: Sequence[int]) -> None:
    if min(size) < 1:
        raise ShotError(f"Not readable: pictures of {name}, as {file}: find them again (File > External Data)")
