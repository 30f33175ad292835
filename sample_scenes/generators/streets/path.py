"""The course of a street: a smooth curve in the plane with a height, and street coordinates (s, t) on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

STEP_M = 0.25
"""Distance of the samples that a course is kept by, metres: at a radius of 30 m a chord is off by 0.3 mm."""
RAMP_M = 8.0
"""Length over which a bend gains and loses its curvature, metres, as roads are built."""


@dataclass(frozen=True, eq=False)
class Path:
    """Samples of a course.

    Attributes:
        s: (N,) arc length; xy: (N, 2); angle: (N,) heading, radians; z: (N,) height of the centre line; curvature: (N,) 1/m.
        tilt: rise towards the left, metres a metre: a street across a slope has it.
    """

    s: np.ndarray
    xy: np.ndarray
    angle: np.ndarray
    z: np.ndarray
    curvature: np.ndarray
    tilt: float = 0.0

    def heading(self, s):  # type: ignore[no-untyped-def]
        """Direction of the street at s, radians."""
        return np.interp(s, self.s, self.angle)

    def grade(self, s: float) -> float:
        """Rise of the street at s, metres a metre."""
        return float(np.interp(s + 0.5, self.s, self.z) - np.interp(s - 0.5, self.s, self.z))

    def bend(self, s: float) -> float:
        """Curvature at s, 1/m, positive to the left."""
        return float(np.interp(s, self.s, self.curvature))

    def place(self, s, t, h=0.0) -> np.ndarray:  # type: ignore[no-untyped-def]
        """World positions (..., 3) of street coordinates: arc length, lateral offset (left positive), height over the centre line."""
        s, t, h = np.broadcast_arrays(np.asarray(s, float), np.asarray(t, float), np.asarray(h, float))
        a = self.heading(s)
        x = np.interp(s, self.s, self.xy[:, 0]) - t * np.sin(a)
        y = np.interp(s, self.s, self.xy[:, 1]) + t * np.cos(a)
        return np.stack([x, y, np.interp(s, self.s, self.z) + self.tilt * t + h], axis=-1)


def bend_curvature(s: np.ndarray, start: float, turn: float, radius: float) -> np.ndarray:
    """(N,) curvature of one bend that begins at ``start``, turns by ``turn`` radians and is nowhere tighter than ``radius``."""
    sign, turn = math.copysign(1.0, turn), abs(turn)
    ramp = min(RAMP_M, turn * radius)
    full = turn * radius - ramp
    return sign / radius * np.clip(np.minimum((s - start) / ramp, (start + 2 * ramp + full - s) / ramp), 0, 1)


def swept(s0: float, s1: float, curvature, rise, *, origin=(0.0, 0.0), angle: float = 0.0, tilt: float = 0.0) -> Path:  # type: ignore[no-untyped-def]
    """A course with the curvature and the height that two functions of s (N,) give; at s = 0 it passes ``origin`` along ``angle``."""
    s = np.arange(math.floor(s0 / STEP_M), math.ceil(s1 / STEP_M) + 1) * STEP_M
    k = curvature(s)
    middle = (k[1:] + k[:-1]) / 2 * STEP_M
    heading = np.concatenate([[0.0], np.cumsum(middle)])
    zero = int(np.argmin(np.abs(s)))
    heading += angle - heading[zero]
    mid = (heading[1:] + heading[:-1]) / 2
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(np.stack([np.cos(mid), np.sin(mid)], 1) * STEP_M, axis=0)])
    return Path(s, xy - xy[zero] + np.asarray(origin), heading, rise(s), k, tilt)


def crest(s: np.ndarray, grade: float, top: float, height: float, width: float) -> np.ndarray:
    """(N,) height: a constant grade, and a smooth crest (or, negative, a dip) of a height and a width at ``top``."""
    return grade * s + height * np.exp(-(((s - top) / width) ** 2))


def corner_curve(a: np.ndarray, u: np.ndarray, b: np.ndarray, v: np.ndarray, radius: float) -> tuple[np.ndarray, float, float]:
    """The arc that leads from the line through ``a`` along ``u`` to that through ``b`` along ``v``, all (2,), directions of travel.

    Returns:
        (M, 2) points of the arc, and how far its ends lie from the lines' meeting point: before it on the first, behind on the second.
    """
    cross = u[0] * v[1] - u[1] * v[0]
    along = ((b - a)[0] * v[1] - (b - a)[1] * v[0]) / cross
    meet = a + along * u
    turn = math.acos(float(np.clip(u @ v, -1, 1)))
    length = radius * math.tan(turn / 2)
    first = meet - length * u
    normal = np.array([-u[1], u[0]]) * math.copysign(1, cross)
    centre = first + radius * normal
    angles = np.linspace(0, turn, max(8, int(turn * radius / 0.3))) * math.copysign(1, cross)
    arm = first - centre
    arc = centre + np.stack([arm[0] * np.cos(angles) - arm[1] * np.sin(angles), arm[0] * np.sin(angles) + arm[1] * np.cos(angles)], 1)
    return arc, length, along
