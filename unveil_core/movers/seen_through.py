"""Evidence from other frames that a place was empty: they show ground or sky where an object would have to be.

A frame that shows ground at a pixel sees along the whole ray down to it. So nothing upright on the ground covers that pixel
in that frame, whatever other objects occlude; an object that another frame shows there has moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px
from unveil_core.geometry.reach import CameraViews
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.contacts import Contacts

__all__ = [
    "MASKED",
    "SLIM",
    "WIDE",
    "Body",
    "DriveVisibility",
    "FrameVisibility",
    "VisibilityEvidence",
    "count_evidence",
    "frame_visibility",
    "probe_points",
]


@dataclass(frozen=True)
class Body:
    """The least extent of a kind of object, and how sure its motion must be.

    Attributes:
        inward_m: distances behind the contact, away from the camera, at least one of which is inside the object, metres.
        heights_m: heights over the ground at which it is solid there, metres.
        error_m: largest uncertainty of a contact that is used, metres.
        drift_m: how far the middle of the visible contacts may wander while the object is static, metres.
        depth_m: how far behind its contact it may reach, metres.
        frames: number of other frames that must see through a contact.
        farther: a frame counts only up to this multiple of the distance from which the contact was seen: labels of small regions
            are poor, and masks omit them.
        outnumber: whether these frames must outnumber those that show an object there.
    """

    inward_m: tuple[float, ...]
    heights_m: tuple[float, ...]
    error_m: float
    drift_m: float
    depth_m: float
    frames: int = 2
    farther: float = 3.0
    outnumber: bool = False

    def seen_through(self, evidence: VisibilityEvidence) -> Mask:
        """(M,) contacts at which no object of this kind can have stayed."""
        through = evidence.through >= self.frames
        return through & (evidence.through > evidence.covered) if self.outnumber else through


WIDE = Body((0.3, 0.9, 1.5), (0.25, 0.45), 0.8, 4.5, 2.4)
"""Vehicles."""
SLIM = Body((0.0, 0.25, 0.5), (0.3, 0.6), 0.4, 1.5, 0.9)
"""People and two-wheelers."""
MASKED = Body((0.3, 0.9, 1.5), (0.25, 0.45), 0.8, 4.5, 2.4, frames=4, farther=1.3, outnumber=True)
"""Objects known by masks alone, most likely vehicles. What the masks do not mark may occlude them, so more frames must agree."""


@dataclass(frozen=True, eq=False)
class FrameVisibility:
    """Where a frame shows the street without objects, and where it shows objects.

    Attributes:
        open: (H, W) pixels surrounded by ground or sky.
        occupied: (H, W) pixels at or beside an object.
    """

    open: Mask
    occupied: Mask


DriveVisibility = CameraViews[FrameVisibility]
"""The visibility of all frames of a drive."""


@dataclass(frozen=True, eq=False)
class VisibilityEvidence:
    """(M,) each: how many other frames see through a contact, and how many show an object there."""

    through: NDArray[np.int64]
    covered: NDArray[np.int64]


def frame_visibility(behind: Mask, removable: Mask) -> FrameVisibility:
    """From the pixels (H, W) that show ground or sky, and those that show objects.

    A pixel counts as ground or sky where the whole square around it, as wide as a border, agrees.
    """
    side = 2 * border_px(behind.shape[1], 1) + 1
    kernel = np.ones((side, side), np.uint8)
    clear = cv2.erode(behind.astype(np.uint8), kernel).astype(bool)
    return FrameVisibility(clear, cv2.dilate(removable.astype(np.uint8), kernel).astype(bool))


def probe_points(contacts: Contacts, camera: Camera, body: Body, ground: HeightField) -> Float64:
    """(M, S, 3) points that would lie inside an object of the kind ``body`` at the contacts that ``camera`` sees."""
    up = ground.axes[2]
    away = contacts.points - camera.centre
    away = away - (away @ up)[:, None] * up
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    steps = [(d, h) for d in body.inward_m for h in body.heights_m]
    places = [contacts.points + (d * away + h * up) for d, h in steps]
    return np.stack(places, axis=1)


def count_evidence(places: Float64, visibility: DriveVisibility, frame: int, *, farther: float) -> VisibilityEvidence:
    """Evidence of the other frames about the probe points (M, S, 3) of ``frame``; a frame sees through at all S or not at all.

    Args:
        farther: another frame counts only up to this multiple of the distance from ``frame`` to the point.
    """
    count, samples = places.shape[:2]
    through, covered = np.zeros(count, np.int64), np.zeros(count, np.int64)
    flat = places.reshape(-1, 3)
    most = farther * visibility.cameras[frame].project(flat)[1]
    for other in visibility.around(flat, visibility.longest_ray * float(most.max(initial=0.0))):
        if other == frame:
            continue
        camera = visibility.cameras[other]
        pixel, depth = camera.project(flat)
        inside = camera.in_picture(pixel, depth) & (depth < most)
        if not inside.any():
            continue
        view = visibility.frames[other]
        row, column = (np.where(inside, pixel[:, k], 0).astype(np.int64) for k in (1, 0))
        clear = (inside & view.open[row, column]).reshape(count, samples)
        occupied = (inside & view.occupied[row, column]).reshape(count, samples)
        through += clear.all(axis=1)
        covered += occupied.any(axis=1)
    return VisibilityEvidence(through, covered)
