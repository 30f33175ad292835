"""A picture of the lines that were found, missed and made up, to look at."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Picture
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.detail.scores import StreetDetail
from unveil_core.evaluate.pictures import fitted, regions_of, truth_file, workspace_mask
from unveil_core.geometry.images import grow

__all__ = ["FALSE", "FOUND", "MISSED", "draw_lines"]

FOUND, MISSED, FALSE = (20, 190, 60), (235, 40, 30), (40, 90, 255)
"""sRGB of true lines that are there, true lines that are not, and lines that the truth does not have."""
PALE = 0.5
"""So much of the clean frame's colours gives way to white, that the lines stand out."""


def draw_lines(root: Path, truth: Path, frame: Frame, size: tuple[int, int]) -> Picture | None:
    """The delivered frame in pale colours with the lines of :mod:`unveil_core.evaluate.detail.lines` on it.

    Args:
        root: the workspace; truth: folder of the truth; size: width and height of the picture.
    Returns:
        (height, width, 3), or None where the truth does not show the frame or no line is compared in it.
    """
    path = truth_file(truth / "images", frame)
    if path is None:
        return None
    delivered, photograph = read_delivered(root, frame), read_image(frame.image_path)
    removed = workspace_mask(root / "masks/removed", frame, delivered.shape)
    regions = regions_of(truth, frame, delivered.shape, removed=removed, unobserved=None)
    street = StreetDetail(truth, frame, fitted(read_image(path), delivered.shape), photograph, regions)
    lines = street.compare(delivered).lines
    if not (lines.found | lines.missed | lines.right | lines.false).any():
        return None
    picture = cv2.resize(delivered, size, interpolation=cv2.INTER_AREA)
    picture = np.round(picture * (1 - PALE) + 255 * PALE).astype(np.uint8)
    # A line is a pixel wide; where the picture is smaller, so wide that it does not fall between two of its pixels.
    wide = -(-delivered.shape[1] // size[0]) // 2
    for mask, color in ((lines.found, FOUND), (lines.false, FALSE), (lines.missed, MISSED)):
        shown = cv2.resize(grow(mask, wide).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        picture[shown] = color
    return picture
