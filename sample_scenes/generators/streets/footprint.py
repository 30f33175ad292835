"""Where a thing stands on the ground, as a rectangle, and what it keeps off."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sample_scenes.generators.streets.plan import KINDS, Leg, Thing


@dataclass(frozen=True, eq=False)
class Footprint:
    """Attributes: centre: (2,); axes: (2, 2), rows along and across; half: (2,) half the length and width, metres."""

    centre: np.ndarray
    axes: np.ndarray
    half: np.ndarray

    def distance(self, points: np.ndarray) -> float:
        """From the nearest of some points (..., 2) to the rectangle, 0 inside; inf where there is no point."""
        outside = np.maximum(np.abs((points - self.centre) @ self.axes.T) - self.half, 0)
        return float(np.min(np.hypot(outside[..., 0], outside[..., 1]), initial=np.inf))

    def overlaps(self, other: Footprint, room: float = 0.0) -> bool:
        """Whether two rectangles come nearer than ``room`` on every one of their axes."""
        between = other.centre - self.centre
        if between @ between > (np.hypot(*self.half) + np.hypot(*other.half) + 2 * room) ** 2:
            return False
        for axis in (*self.axes, *other.axes):
            reach = np.abs(self.axes @ axis) @ self.half + np.abs(other.axes @ axis) @ other.half
            if abs(between @ axis) > reach + room:
                return False
        return True


def footprint(thing: Thing, legs: list[Leg], time: float = 0.0) -> Footprint:
    """Of a thing at a time, seconds."""
    leg = legs[thing.leg]
    s, t = thing.at(time)
    angle = float(leg.path.heading(s)) + thing.turn
    axes = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    length, width, _ = KINDS[thing.kind].size
    return Footprint(leg.path.place(s, t)[:2], axes, np.array([length, width]) / 2)
