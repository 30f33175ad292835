"""Proof by other frames that a place was empty: they show ground or sky where what stands there would have to be.

A frame that shows ground at a pixel sees along the whole ray down to it. So a stick that stands on the ground and covers that
pixel is not there, whatever other things hide; and what another frame shows there has come or gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px
from unveil_core.ground.sparse import GroundPoints
from unveil_core.movers.contacts import Contacts

__all__ = ["MASKED", "SLIM", "Body", "Evidence", "Sight", "WIDE", "look_through", "sight_of", "sticks"]


@dataclass(frozen=True)
class Body:
    """What a kind of thing is at least.

    Attributes:
        inward_m: places behind the contact, away from the camera, of which one at least lies inside it, metres.
        heights_m: over the ground at which it is solid there, metres.
        error_m: how uncertain a contact may be, metres.
        drift_m: how far the middle of the visible contacts may wander while the thing stands still, metres.
        depth_m: how far behind its contact it may reach, metres.
        frames: so many other frames must look through a contact.
        farther: frames that see the place from farther away than so many times the distance do not count: labels of what is small
            are poor, and masks leave it out.
        outnumber: whether they must be more than those that show something there.
    """

    inward_m: tuple[float, ...]
    heights_m: tuple[float, ...]
    error_m: float
    drift_m: float
    depth_m: float
    frames: int = 2
    farther: float = 3.0
    outnumber: bool = False

    def seen_through(self, evidence: Evidence) -> Mask:
        """(M,) contacts at which nothing of this kind can have stayed."""
        through = evidence.through >= self.frames
        return through & (evidence.through > evidence.covered) if self.outnumber else through


WIDE = Body((0.3, 0.9, 1.5), (0.25, 0.45), 0.8, 4.5, 2.4)
"""Vehicles."""
SLIM = Body((0.0, 0.25, 0.5), (0.3, 0.6), 0.4, 1.5, 0.9)
"""People and two-wheelers."""
MASKED = Body((0.3, 0.9, 1.5), (0.25, 0.45), 0.8, 4.5, 2.4, frames=4, farther=1.3, outnumber=True)
"""What only masks tell of: vehicles most likely. What masks keep may hide it, so more frames must agree."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What a frame proves.

    Attributes:
        camera: of the frame.
        open: (H, W) pixels amid ground or sky.
        taken: (H, W) pixels at or beside something that might stand in the street.
    """

    camera: Camera
    open: Mask
    taken: Mask


@dataclass(frozen=True, eq=False)
class Evidence:
    """How many other frames look through each of M contacts, and how many show something there that might stand in it."""

    through: NDArray[np.int64]
    covered: NDArray[np.int64]


def sight_of(camera: Camera, behind: Mask, removable: Mask) -> Sight:
    """From the pixels (H, W) that show ground or sky, and those of what may stand in the street.

    A pixel counts as ground or sky where all around it agrees, as far as a border reaches.
    """
    side = 2 * border_px(camera.width, 1) + 1
    kernel = np.ones((side, side), np.uint8)
    clear = cv2.erode(behind.astype(np.uint8), kernel).astype(bool)
    return Sight(camera, clear, cv2.dilate(removable.astype(np.uint8), kernel).astype(bool))


def sticks(contacts: Contacts, camera: Camera, body: Body, ground: GroundPoints) -> Float64:
    """(M, S, 3) places inside what would stand at the contacts that ``camera`` sees."""
    up = ground.axes[2]
    away = contacts.points - camera.centre
    away = away - (away @ up)[:, None] * up
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    steps = [(d, h) for d in body.inward_m for h in body.heights_m]
    places = [contacts.points + (d * away + h * up) for d, h in steps]
    return np.stack(places, axis=1)


def look_through(places: Float64, sights: Sequence[Sight], own: int, *, farther: float) -> Evidence:
    """What the other frames say of sticks (M, S, 3) of frame ``own``: a frame sees through only if it does so at all S.

    Args:
        farther: frames farther from a place than so many times the distance of frame ``own`` say nothing of it.
    """
    count, samples = places.shape[:2]
    through, covered = np.zeros(count, np.int64), np.zeros(count, np.int64)
    flat = places.reshape(-1, 3)
    most = farther * sights[own].camera.project(flat)[1]
    for other, sight in enumerate(sights):
        if other == own or not count:
            continue
        camera = sight.camera
        pixel, depth = camera.project(flat)
        inside = camera.in_picture(pixel, depth) & (depth < most)
        row, column = (np.where(inside, pixel[:, k], 0).astype(np.int64) for k in (1, 0))
        clear = (inside & sight.open[row, column]).reshape(count, samples)
        taken = (inside & sight.taken[row, column]).reshape(count, samples)
        through += clear.all(axis=1)
        covered += taken.any(axis=1)
    return Evidence(through, covered)
