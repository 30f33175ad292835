"""A street of any length for measurements of size: houses, parked cars and now and then a lorry, drawn by seed from boxes."""

from __future__ import annotations

import numpy as np

from tests.worlds.box_worlds import BUILDING, CAR, TRUCK, Box, Lens, Way, World

__all__ = ["long_street", "long_way"]

FACADE_M, KERB_M = 9.0, 4.5
REACH_M = 400.0
"""How far the pictures show the street, metres: a drive of several blocks must see the houses of the next ones, as cameras do."""
BEYOND_M = 400.0
"""How far the street goes on behind the first and the last camera, metres."""


def long_street(length: float, seed: int = 0) -> World:
    """The street along x from 0 to ``length`` metres; its first part is the same whatever the length."""
    generator = np.random.default_rng(seed)
    boxes: list[Box] = []
    for side in (-1, 1):
        x = -BEYOND_M
        while x < length + BEYOND_M:
            wide, tall = generator.uniform(9, 18), generator.uniform(7, 13)
            color = tuple(generator.uniform(0.45, 0.85, 3))
            deep = generator.uniform(0, 1.5)
            centre = (x + wide / 2, side * (FACADE_M + deep + 4), tall / 2)
            boxes.append(Box(centre, (wide, 8.0, tall), BUILDING, color, windows=True))  # type: ignore[arg-type]
            x += wide + (generator.uniform(2, 5) if generator.uniform() < 0.2 else 0.0)
        x = -BEYOND_M
        while x < length + BEYOND_M:
            lorry = generator.uniform() < 0.06
            size = (9.0, 2.4, 3.0) if lorry else (4.3, 1.8, 1.5)
            color = tuple(generator.uniform(0.1, 0.9, 3))
            centre = (x, side * (KERB_M - 1.2), size[2] / 2 + 0.05)
            boxes.append(Box(centre, size, TRUCK if lorry else CAR, color, removed=True))  # type: ignore[arg-type]
            x += size[0] + generator.choice([1.2, 6.0, 15.0])
    return World(sorted(boxes, key=lambda b: b.centre[0]), reach=REACH_M)


def long_way(frames: int, step_m: float = 1.0, size: tuple[int, int] = (480, 320)) -> Way:
    """A car that drives along it with one camera of about 75 degrees; the first frames are the same whatever their number."""
    x = step_m * np.arange(frames)
    y = 0.4 * np.sin(x / 17) + 0.2 * np.sin(x / 5.3)
    slope = 0.4 / 17 * np.cos(x / 17) + 0.2 / 5.3 * np.cos(x / 5.3)
    heading = np.degrees(np.arctan(slope))
    places = [(float(a), float(b), 1.6) for a, b in zip(x, y, strict=True)]
    return Way(places, heading.tolist(), [Lens(size=size, focal=0.65 * size[0])])
