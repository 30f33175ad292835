"""The frames that show an object, and its thumbnail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unveil_core.drives.drive import Drive
from unveil_core.semantics.visibility import PointsInView

__all__ = ["Sighting", "best_sighting", "sightings_in_images", "sightings_of_points", "thumbnail"]

LEAST_PIXELS, LEAST_POINTS = 12, 5
"""Fewer of them are noise, no sight of an object."""
Sightings = dict[int, list["Sighting"]]


@dataclass(frozen=True)
class Sighting:
    """One frame that shows an object.

    Attributes:
        frame: its index in the drive.
        rectangle: (x0, y0, x1, y1) pixels that the object spans.
    """

    frame: int
    rectangle: tuple[int, int, int, int]


def sightings_in_images(images: Sequence[NDArray[np.integer] | None]) -> Sightings:
    """Where instance images (H, W) per frame, 0 = none, show which id."""
    found: Sightings = {}
    for v, image in enumerate(images):
        if image is None or not image.any():
            continue
        counts = np.bincount(image.ravel().astype(np.int64))
        for number, place in enumerate(ndimage.find_objects(image), start=1):
            if place is not None and counts[number] >= LEAST_PIXELS:
                rows, columns = place
                rectangle = (columns.start, rows.start, columns.stop, rows.stop)
                found.setdefault(number, []).append(Sighting(v, rectangle))
    return found


def sightings_of_points(ids: NDArray[np.int64], views: Sequence[PointsInView]) -> Sightings:
    """Where views see points of objects: ``ids`` (P,) of all points, 0 = none."""
    found: Sightings = {}
    for v, seen in enumerate(views):
        seen_ids = ids[seen.index]
        for number in np.unique(seen_ids[seen_ids > 0]):
            rows, columns = seen.rows[seen_ids == number], seen.columns[seen_ids == number]
            if len(rows) >= LEAST_POINTS:
                rectangle = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
                found.setdefault(int(number), []).append(Sighting(v, rectangle))
    return found


def best_sighting(drive: Drive, sightings: Sequence[Sighting]) -> Sighting:
    """The one that shows most of an object, best without its being cut off."""

    def area(sighting: Sighting) -> tuple[int, int]:
        camera = drive.frames[sighting.frame].camera
        x0, y0, x1, y1 = sighting.rectangle
        inner = x0 > 1 and x1 < camera.width - 1 and y1 < camera.height - 1
        return (x1 - x0) * (y1 - y0) * (2 if inner else 1), -sighting.frame

    return max(sightings, key=area)


def thumbnail(image: NDArray[np.uint8], rectangle: tuple[int, int, int, int], side: int = 96) -> NDArray[np.uint8]:
    """(side, side, 3) the square around a rectangle (x0, y0, x1, y1) of an image."""
    x0, y0, x1, y1 = rectangle
    half = max(x1 - x0, y1 - y0) * 0.6
    cx, cy = (x0 + x1) / 2, (y0 + y1) / 2
    matrix = np.array([[2 * half / side, 0, cx - half], [0, 2 * half / side, cy - half]])
    picture = cv2.warpAffine(
        image, matrix, (side, side), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )
    return picture.astype(np.uint8)
