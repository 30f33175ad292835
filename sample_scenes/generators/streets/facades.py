"""Builds the lots: row houses of plaster or brick, shops, offices, detached houses, halls, gardens, hedges and walls."""

from __future__ import annotations

import bpy
import numpy as np

from sample_scenes.generators.parked_street import build_street as kit
from sample_scenes.generators.streets import materials as made
from sample_scenes.generators.streets.mesh import Builder, stations
from sample_scenes.generators.streets.plan import BUILDING, FENCE, TERRAIN, VEGETATION, WALL, Leg, Lot

FLOOR_M = 3.0
DEPTH_M = 8.0
LIT = 0.45
"""Share of the windows that are lit at dusk."""


class House:
    """One building on a lot: its front lies at a distance from the street's middle, between two places along it."""

    def __init__(self, builder: Builder, leg: Leg, lot: Lot, wall: str) -> None:
        self.b, self.leg, self.lot, self.wall, self.side = builder, leg, lot, wall, lot.side
        self.front = leg.section.back(lot.side) + lot.setback
        self.base = leg.section.kerb
        self.rng = np.random.default_rng(lot.key)
        self.roof = "tiles" if lot.key % 2 else "slate"

    def box(self, material: str, s: float, out: float, h: float, size: tuple[float, float, float], label: int = BUILDING) -> None:
        """A box whose middle stands ``out`` metres before the front, its base ``h`` over the ground floor's level."""
        self.b.street_box(material, label, self.leg, s, self.side * (self.front - out), self.base + h, size)

    def shell(self, s0: float, s1: float, height: float, roof: str) -> None:
        """Walls all around, down below the ground; and a roof: "pitched" or "flat"."""
        leg, side, base = self.leg, self.side, self.base
        t0, t1 = side * self.front, side * (self.front + DEPTH_M)
        s = stations(s0, s1)[::2]
        s = np.append(s, s1) if s[-1] < s1 else s
        levels = np.array([base - 1.2, base + height])
        for t in (t0, t1):
            points = leg.path.place(s[:, None], t, levels[None])
            self.b.grid(self.wall, BUILDING, points, np.stack(np.broadcast_arrays(s[:, None], levels[None]), axis=-1))
        tm = (t0 + t1) / 2
        rise = 2.4 if roof == "pitched" else 0.0
        for at in (s0, s1):
            t = np.array([t0, t1, t1, tm, t0])
            h = np.array([base - 1.2, base - 1.2, base + height, base + height + rise, base + height])
            self.b.add(self.wall, BUILDING, leg.path.place(at, t, h), [(0, 1, 2, 3, 4)], np.stack([np.abs(t), h], axis=1))
        if roof == "pitched":
            eave = side * 0.35
            profile = [(t0 - eave, base + height - 0.12), (tm, base + height + rise + 0.05), (t1 + eave, base + height - 0.12)]
            self.b.sweep(self.roof, BUILDING, leg, s0, s1, profile)
        else:
            self.b.sweep("concrete", BUILDING, leg, s0, s1, [(t0, base + height), (t1, base + height)])
            self.b.sweep("white", BUILDING, leg, s0, s1, [(t0 - side * 0.12, base + height - 0.2), (t0 - side * 0.12, base + height + 0.15), (t0, base + height + 0.15)])

    def window(self, s: float, sill: float, wide: float, tall: float) -> None:
        """A window with frame, cross bars and sill."""
        glass = "lit window" if self.rng.uniform() < LIT else "window"
        self.box("white", s, 0.0, sill - 0.06, (wide + 0.16, 0.1, tall + 0.12))
        self.box(glass, s, 0.03, sill, (wide, 0.09, tall))
        if wide < 1.6:
            self.box("white", s, 0.05, sill, (0.06, 0.08, tall))
        self.box("white", s, 0.05, sill + tall * 0.62, (wide, 0.08, 0.05))
        self.box("stone", s, 0.1, sill - 0.13, (wide + 0.3, 0.24, 0.08))

    def door(self, s: float) -> None:
        """A door with lintel and step."""
        self.box("white", s, 0.0, -0.2, (1.25, 0.1, 2.62))
        self.box("door", s, 0.03, -0.2, (1.05, 0.12, 2.5))
        self.box("stone", s, 0.22, -0.4, (1.3, 0.44, 0.46))

    def rows(self, s0: float, s1: float, first: int, floors: int) -> None:
        """Windows of the floors from ``first`` up; a door among those of the ground floor."""
        bays = max(2, int((s1 - s0) / float(self.rng.uniform(2.1, 3.0))))
        spacing = (s1 - s0) / bays
        wide, tall = min(float(self.rng.uniform(0.9, 1.6)), spacing - 0.7), float(self.rng.uniform(1.25, 1.75))
        door = int(self.rng.integers(0, bays))
        for floor in range(first, floors):
            for bay in range(bays):
                s = s0 + (bay + 0.5) * spacing
                if floor == 0 and bay == door:
                    self.door(s)
                else:
                    self.window(s, 0.95 + FLOOR_M * floor, wide, tall)

    def row_house(self) -> None:
        """Plaster or brick up to the sidewalk's edge."""
        lot, height = self.lot, 0.6 + FLOOR_M * self.lot.floors
        self.shell(lot.s0, lot.s1, height, "pitched")
        t = self.side * self.front
        self.b.sweep("stone", BUILDING, self.leg, lot.s0, lot.s1, [(t - self.side * 0.06, self.base - 0.3), (t - self.side * 0.06, self.base + 0.6), (t, self.base + 0.63)])
        self.rows(lot.s0, lot.s1, 0, lot.floors)

    def shop(self) -> None:
        """A glass front on the ground floor with a sign board and an awning or none, flats above."""
        lot, width = self.lot, self.lot.s1 - self.lot.s0
        self.shell(lot.s0, lot.s1, 0.9 + FLOOR_M * lot.floors, "pitched")
        middle = (lot.s0 + lot.s1) / 2
        door = lot.s0 + float(self.rng.uniform(1.0, width - 1.0))
        panes = max(2, int((width - 0.8) / 1.9))
        step = (width - 0.8) / panes
        self.box("black", middle, 0.0, -0.2, (width - 0.6, 0.12, 2.95))
        for k in range(panes):
            at = lot.s0 + 0.4 + (k + 0.5) * step
            low = 0.05 if abs(at - door) < step / 2 else 0.42
            self.box("lit window" if self.rng.uniform() < 0.7 else "glass front", at, 0.06, low, (step - 0.14, 0.06, 2.5 - low))
        board = f"board {lot.key % 4}"
        self.box(board, middle, 0.14, 2.62, (width - 0.5, 0.18, 0.5))
        if self.rng.uniform() < 0.4:
            t = self.side * self.front
            self.b.sweep(board, BUILDING, self.leg, lot.s0 + 0.5, lot.s1 - 0.5, [(t, self.base + 2.62), (t - self.side * 0.95, self.base + 2.28), (t - self.side * 0.95, self.base + 2.12)])
        self.rows(lot.s0, lot.s1, 1, lot.floors)

    def office(self) -> None:
        """Bands of glass between bands of concrete."""
        lot, width = self.lot, self.lot.s1 - self.lot.s0
        self.shell(lot.s0, lot.s1, 0.4 + 3.3 * lot.floors, "flat")
        pieces = max(4, int(width / 1.5))
        for floor in range(lot.floors):
            for k in range(pieces):
                s = lot.s0 + (k + 0.5) * width / pieces
                glass = "lit window" if self.rng.uniform() < 0.25 else "glass front"
                self.box(glass, s, 0.02, 0.95 + 3.3 * floor if floor else 0.15, (width / pieces - 0.1, 0.08, 1.9 if floor else 2.7))

    def detached(self) -> None:
        """A house or hall behind its front garden, with room to its neighbours."""
        lot = self.lot
        room = min(1.8, (lot.s1 - lot.s0) * 0.14)
        s0, s1 = lot.s0 + room, lot.s1 - room
        hall = lot.style == "hall"
        self.shell(s0, s1, 5.2 if hall else 0.5 + FLOOR_M * lot.floors, "flat" if hall else "pitched")
        if hall:
            for s in np.arange(s0 + 3, s1 - 2, 6.0):
                self.box("steel", float(s), 0.03, -0.1, (3.6, 0.1, 3.6))
        else:
            self.rows(s0, s1, 0, lot.floors)


def build_lot(builder: Builder, materials: dict[str, bpy.types.Material], leg: Leg, lot: Lot) -> None:
    """One lot with everything on it but its trees."""
    wall = f"{lot.style} {tuple(round(c, 2) for c in lot.color)}"
    if wall not in materials:
        brick = kit.slabs(wall, lot.color, tuple(c * 0.8 for c in lot.color), 0.24, 0.08) if lot.style == "brick" else None
        materials[wall] = brick or made.plaster(wall, lot.color)
    for number, color in enumerate([(0.35, 0.04, 0.05), (0.05, 0.12, 0.30), (0.06, 0.22, 0.12), (0.55, 0.40, 0.06)]):
        if f"board {number}" not in materials:
            materials[f"board {number}"] = made.plain(f"board {number}", color)
    house = House(builder, leg, lot, wall)
    if lot.style in ("plaster", "brick"):
        house.row_house()
    elif lot.style == "shop":
        house.shop()
    elif lot.style == "office":
        house.office()
    elif lot.style in ("house", "hall"):
        house.detached()
    _front(builder, leg, lot)


def _front(builder: Builder, leg: Leg, lot: Lot) -> None:
    """What bounds the lot towards the street, and its garden's ground."""
    side, back, h = lot.side, leg.section.back(lot.side), leg.section.kerb
    style = {"hedge": "hedge", "wall": "wall", "gap": "low wall"}.get(lot.style, lot.front)
    t = side * (back + 0.3)
    if lot.setback or lot.style in ("garden", "hedge", "gap"):
        far = back + (lot.setback or 6.0)
        ground = "yard" if lot.style in ("gap", "hall") else "grass"
        builder.sweep(ground, TERRAIN, leg, lot.s0, lot.s1, [(side * back, h + 0.015), (side * far, h + 0.0)])
    gate = (lot.s0 + 1.0, lot.s0 + 3.2) if lot.style in ("house", "hall", "gap") else (lot.s0, lot.s0)
    for s0, s1 in ((lot.s0 + 0.02, gate[0]), (gate[1], lot.s1 - 0.02)):
        if s1 - s0 < 0.3:
            continue
        if style == "hedge":
            _hedge(builder, leg, lot, s0, s1, side * (back + 0.45))
        elif style == "fence":
            for s in np.arange(s0, s1, 2.0):
                builder.street_box("wood", FENCE, leg, float(s), t, h - 0.1, (0.09, 0.09, 1.15))
            for s in np.arange(s0, s1 - 0.05, 0.16):
                builder.street_box("wood", FENCE, leg, float(s), t - side * 0.05, h + 0.08, (0.1, 0.025, 0.92))
        elif style in ("low wall", "wall"):
            top = h + (1.9 if style == "wall" else 0.6)
            builder.sweep("concrete", WALL, leg, s0, s1, [(t - side * 0.12, h - 0.5), (t - side * 0.12, top), (t + side * 0.12, top), (t + side * 0.12, h - 0.5)])
            for s in (s0, s1):
                builder.street_box("concrete", WALL, leg, s, t, h - 0.4, (0.3, 0.34, top - h + 0.46))


def _hedge(builder: Builder, leg: Leg, lot: Lot, s0: float, s1: float, t: float) -> None:
    """A clipped hedge whose surface is rough."""
    rng = np.random.default_rng(lot.key)
    height = float(rng.uniform(0.9, 2.0))
    s = np.arange(s0, s1, 0.14)
    ring = [(-0.4, 0.0), (-0.42, 0.3), (-0.42, 0.6), (-0.4, 0.85), (-0.3, 1.0), (0.0, 1.03), (0.3, 1.0), (0.4, 0.85), (0.42, 0.5), (0.4, 0.0)]
    offsets, levels = np.array(ring).T
    rough = rng.normal(0, 0.035, (2, len(s), len(ring)))
    points = leg.path.place(s[:, None], t + offsets[None] + rough[0], leg.section.kerb - 0.05 + height * levels[None] + rough[1])
    builder.grid("hedge", VEGETATION, points)
    for row in (0, -1):
        builder.add("hedge", VEGETATION, points[row], [tuple(range(len(ring)))])
