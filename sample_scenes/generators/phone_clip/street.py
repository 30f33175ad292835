"""A street of boxes with textures that have detail at every distance: houses, hedges, trees, lamps, parked cars, a person."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

__all__ = ["ASPHALT", "BRICK", "CLOTH", "GLASS", "LEAVES", "METAL", "PAINT", "PLASTER", "SLABS", "WOOD", "Street", "make_street"]

ASPHALT, SLABS, BRICK, PLASTER, PAINT, GLASS, LEAVES, METAL, WOOD, CLOTH = range(10)
ROAD_CLASS, SIDEWALK_CLASS, BUILDING_CLASS, POLE_CLASS, PLANT_CLASS, PERSON_CLASS, CAR_CLASS = 0, 1, 2, 5, 8, 11, 13
KERB_M, FACADE_M = 3.6, 6.4
"""From the middle of the road to its edge, and to the houses."""


@dataclass
class Street:
    """Boxes, each in a row of these arrays.

    Attributes:
        centre, half: (B, 3) metres; turn: (B, 2) cosine and sine of the yaw; colour: (B, 3) reflectance.
        material, kind, thing: (B,) its texture, Cityscapes trainId, and number of the object that it belongs to, 0 = none.
    """

    centre: list[tuple[float, float, float]] = field(default_factory=list)
    half: list[tuple[float, float, float]] = field(default_factory=list)
    turn: list[tuple[float, float]] = field(default_factory=list)
    colour: list[tuple[float, float, float]] = field(default_factory=list)
    material: list[int] = field(default_factory=list)
    kind: list[int] = field(default_factory=list)
    thing: list[int] = field(default_factory=list)

    def add(self, centre, size, material, kind, colour, *, yaw=0.0, thing=0) -> None:  # type: ignore[no-untyped-def]
        """One box; ``size`` is its length, width, height."""
        self.centre.append(tuple(map(float, centre)))
        self.half.append((size[0] / 2, size[1] / 2, size[2] / 2))
        self.turn.append((float(np.cos(yaw)), float(np.sin(yaw))))
        self.colour.append(tuple(map(float, colour)))
        self.material.append(material)
        self.kind.append(kind)
        self.thing.append(thing)

    def arrays(self, *, crowded: bool) -> tuple[np.ndarray, ...]:
        """As the renderer takes them; ``crowded``: with cars and people."""
        keep = np.array([crowded or thing == 0 for thing in self.thing])
        names = ("centre", "half", "turn", "colour", "material", "kind", "thing")
        return tuple(np.array(getattr(self, name))[keep] for name in names)


def make_street(seed: int = 4, length: float = 110.0) -> Street:
    """The street along x; its road and sidewalks are boxes, too."""
    rng, street = np.random.default_rng(seed), Street()
    start, end = -20.0, length
    middle, long = (start + end) / 2, end - start
    street.add((middle, 0, -0.5), (long + 300, 2 * KERB_M, 1.0), ASPHALT, ROAD_CLASS, (0.19, 0.19, 0.195))
    for side in (-1, 1):
        street.add((middle, side * (KERB_M + 30), -0.37), (long + 300, 60, 1.0), SLABS, SIDEWALK_CLASS, (0.42, 0.40, 0.37))
        _houses(street, rng, side, start, end)
        _furniture(street, rng, side, start, end)
    _cars(street, rng, start, end)
    return street


def _houses(street: Street, rng: np.random.Generator, side: int, start: float, end: float) -> None:
    x = start
    while x < end:
        wide, tall, back = rng.uniform(8, 15), rng.uniform(6.5, 12), rng.uniform(0, 0.8)
        brick = rng.random() < 0.5
        base = np.array((0.36, 0.19, 0.14) if brick else (0.62, 0.58, 0.50)) * rng.uniform(0.75, 1.25, 3)
        y = side * (FACADE_M + back + 4)
        street.add((x + wide / 2, y, tall / 2), (wide, 8, tall), BRICK if brick else PLASTER, BUILDING_CLASS, base)
        face = side * (FACADE_M + back)
        door = x + rng.uniform(1.5, wide - 1.5)
        street.add((door, face, 1.2), (1.1, 0.16, 2.1), WOOD, BUILDING_CLASS, rng.uniform(0.08, 0.4, 3))
        street.add((x + wide / 2, face - side * 0.1, tall - 0.2), (wide, 0.5, 0.35), PLASTER, BUILDING_CLASS, base * 0.7)
        street.add((x + wide / 2, face - side * 0.03, 0.42), (wide, 0.1, 0.6), PLASTER, BUILDING_CLASS, base * 0.5)
        x += wide
        if rng.random() < 0.35:
            gap = rng.uniform(2.5, 5)
            street.add((x + gap / 2, side * (FACADE_M + 1.2), 0.85), (gap, 1.0, 1.5), LEAVES, PLANT_CLASS, (0.10, 0.19, 0.05))
            x += gap


def _furniture(street: Street, rng: np.random.Generator, side: int, start: float, end: float) -> None:
    for x in np.arange(start + 6 + 5 * (side > 0), end, 14.0):
        y = side * (KERB_M + 0.7)
        if rng.random() < 0.5:
            street.add((x, y, 2.9), (0.12, 0.12, 5.6), METAL, POLE_CLASS, (0.22, 0.23, 0.24))
            street.add((x, y - side * 0.5, 5.7), (0.3, 1.2, 0.14), METAL, POLE_CLASS, (0.3, 0.3, 0.3))
            continue
        street.add((x, y, 1.3), (0.24, 0.24, 2.4), WOOD, PLANT_CLASS, (0.16, 0.11, 0.07))
        for _ in range(7):
            at = (x + rng.normal(0, 0.8), y + rng.normal(0, 0.7), 3.4 + rng.normal(0, 0.6))
            size = rng.uniform(0.8, 1.7, 3)
            street.add(at, size, LEAVES, PLANT_CLASS, np.array((0.10, 0.20, 0.05)) * rng.uniform(0.7, 1.3), yaw=rng.uniform(0, 1.5))


def _cars(street: Street, rng: np.random.Generator, start: float, end: float) -> None:
    thing = 0
    for side in (-1, 1):
        x = start + 8.0 + 3 * (side > 0)
        while x < end - 30:
            thing += 1
            paint = rng.uniform(0.03, 0.6, 3) if rng.random() < 0.6 else np.full(3, rng.uniform(0.05, 0.7))
            tall, long = rng.uniform(0.62, 0.8), rng.uniform(3.9, 4.6)
            y, low = side * (KERB_M - 1.05), 0.28
            turn = rng.normal(0, 0.02)
            street.add((x, y, low + tall / 2), (long, 1.74, tall), PAINT, CAR_CLASS, paint, yaw=turn, thing=thing)
            roof = low + tall
            street.add((x - 0.15, y, roof + 0.26), (long * 0.52, 1.52, 0.52), GLASS, CAR_CLASS, (0.03, 0.035, 0.04), yaw=turn, thing=thing)
            street.add((x - 0.15, y, roof + 0.55), (long * 0.46, 1.46, 0.07), PAINT, CAR_CLASS, paint, yaw=turn, thing=thing)
            for dx in (-0.31, 0.31):
                for dy in (-0.79, 0.79):
                    at = (x + dx * long, y + dy, 0.31)
                    street.add(at, (0.62, 0.22, 0.62), METAL, CAR_CLASS, (0.03, 0.03, 0.03), yaw=turn, thing=thing)
            x += long + (rng.uniform(0.9, 2.0) if rng.random() < 0.6 else rng.uniform(6, 13))
    thing += 1
    for size, z, colour in (((0.3, 0.42, 0.8), 0.53, (0.1, 0.12, 0.3)), ((0.32, 0.52, 0.62), 1.24, (0.5, 0.12, 0.1)), ((0.2, 0.18, 0.26), 1.68, (0.5, 0.34, 0.26))):
        street.add((24.0, KERB_M + 1.3, z), size, CLOTH, PERSON_CLASS, colour, yaw=0.4, thing=thing)
