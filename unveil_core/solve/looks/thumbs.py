"""Small grey pictures of the frames, on which everything is measured that has to be known within seconds."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64
from unveil_core.solve.footage.frames import FootageFrame

__all__ = ["FLOW_PX", "LOOK_PX", "Grey", "Thumbs", "take_thumbs"]

LOOK_PX = 640
"""Longer side of the pictures in which corners are followed."""
FLOW_PX = 320
"""Longer side of those in which motion is measured in every pixel."""
Grey = NDArray[np.uint8]


class Thumbs:
    """Small pictures of one camera's frames.

    Attributes:
        frames: that they show.
        sharpness: (N,) variance of the Laplacian.
        brightness: (N,) mean grey.
    """

    def __init__(self, frames: tuple[FootageFrame, ...], pictures: list[Grey]) -> None:
        self.frames, self.pictures = frames, pictures
        self.sharpness: Float64 = np.array([cv2.Laplacian(p, cv2.CV_32F).var() for p in pictures])
        self.brightness: Float64 = np.array([float(p.mean()) for p in pictures])

    def small(self, i: int) -> Grey:
        """The picture of a frame at the size in which motion is measured."""
        picture = self.pictures[i]
        scale = FLOW_PX / max(picture.shape)
        if scale >= 1:
            return picture
        size = (max(8, round(picture.shape[1] * scale)), max(8, round(picture.shape[0] * scale)))
        return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def take_thumbs(images: Path, frames: tuple[FootageFrame, ...], progress: Progress = no_progress) -> Thumbs:
    """Small pictures of frames in ``images``.

    Raises:
        DriveError: one cannot be read.
    """
    found = []
    for done, frame in enumerate(frames):
        grey = cv2.cvtColor(read_image(images / frame.file), cv2.COLOR_RGB2GRAY)
        scale = LOOK_PX / max(grey.shape)
        if scale < 1:
            size = (max(8, round(grey.shape[1] * scale)), max(8, round(grey.shape[0] * scale)))
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        found.append(grey)
        progress(done + 1, len(frames), "looking at frames")
    return Thumbs(frames, found)
