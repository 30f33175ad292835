"""Lamps, signs, poles, traffic lights, bollards, bins and cabinets along the street."""

from __future__ import annotations

import math

import numpy as np

from sample_scenes.generators.streets.mesh import Builder
from sample_scenes.generators.streets.plan import BUILDING, LIGHT, POLE, SIGN, Leg, Post

LAMP_M = 6.2
"""Height of a lamp's head, metres."""
ARM_M = 1.5


def lamp_place(leg: Leg, post: Post) -> np.ndarray:
    """Where a lamp's head hangs (3,)."""
    side = 1 if post.t > 0 else -1
    return leg.path.place(post.s, post.t - side * ARM_M, leg.section.kerb + LAMP_M - 0.12)


def build_post(builder: Builder, leg: Leg, post: Post) -> None:
    """Anything but a tree."""
    h = leg.section.kerb
    foot = leg.path.place(post.s, post.t, h - 0.1)
    side = 1 if post.t > 0 else -1
    if post.kind == "lamp":
        builder.cylinder("steel", POLE, foot, 0.09, LAMP_M + 0.1, 0.05)
        builder.street_box("steel", POLE, leg, post.s, post.t - side * ARM_M / 2, h + LAMP_M, (0.07, ARM_M, 0.07))
        builder.street_box("steel", POLE, leg, post.s, post.t - side * ARM_M, h + LAMP_M - 0.02, (0.26, 0.62, 0.1))
        builder.street_box("lamp head", POLE, leg, post.s, post.t - side * ARM_M, h + LAMP_M - 0.05, (0.2, 0.54, 0.03))
    elif post.kind == "sign":
        builder.cylinder("steel", POLE, foot, 0.032, 2.75, sides=8)
        _disc(builder, leg, post, h + 2.3, post.key % 3)
    elif post.kind == "pole":
        builder.cylinder("wood", POLE, foot, 0.14, 7.8, 0.1)
        builder.street_box("wood", POLE, leg, post.s, post.t, h + 7.0, (0.1, 1.7, 0.1))
    elif post.kind == "traffic light":
        builder.cylinder("steel", POLE, foot, 0.06, 3.4)
        facing = -1 if post.t < 0 else 1
        builder.street_box("black", LIGHT, leg, post.s, post.t, h + 2.4, (0.22, 0.3, 0.9))
        builder.street_box("light red", LIGHT, leg, post.s + facing * 0.11, post.t, h + 3.02, (0.03, 0.18, 0.18))
    elif post.kind == "bollard":
        builder.cylinder("white", POLE, foot, 0.06, 1.0)
        builder.cylinder("sign red", POLE, foot + (0, 0, 0.75), 0.063, 0.15)
    elif post.kind == "bin":
        builder.cylinder("iron", POLE, foot, 0.22, 0.95, 0.25)
    elif post.kind == "cabinet":
        builder.street_box("concrete", BUILDING, leg, post.s, post.t, h - 0.1, (0.9, 0.35, 1.25))


def _disc(builder: Builder, leg: Leg, post: Post, h: float, kind: int) -> None:
    """A round, triangular or square plate that faces those who come on its side, on a grey back."""
    count, turn = ((28, 0.0), (3, math.pi / 2), (4, math.pi / 4))[kind]
    facing = -1 if post.t < 0 else 1
    angle = float(leg.path.heading(post.s))
    base = leg.path.place(post.s, post.t, h)
    a = np.linspace(0, 2 * math.pi, count + 1)[:-1] + turn
    layers = (("sign red", 0.34, 0.045), ("sign blue" if kind == 0 else "white", 0.24, 0.052)) if kind < 2 else (("sign yellow", 0.36, 0.045),)
    for material, radius, lift in (("steel", 0.345, 0.038), *layers):
        across, up = radius * np.cos(a), radius * np.sin(a)
        points = np.stack([
            base[0] + facing * lift * math.cos(angle) - across * math.sin(angle),
            base[1] + facing * lift * math.sin(angle) + across * math.cos(angle), base[2] + up,
        ], axis=1)  # fmt: skip
        builder.add(material, SIGN, points, [tuple(range(count))])
