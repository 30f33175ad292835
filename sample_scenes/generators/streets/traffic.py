"""Draws what is removed: parked and standing vehicles, bicycles, people, and in some streets moving ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sample_scenes.generators.streets.cameras import route_at, station_distances, station_times
from sample_scenes.generators.streets.footprint import Footprint, footprint
from sample_scenes.generators.streets.plan import CAR, KINDS, Leg, Plan, Thing

CAMERA_ROOM_M = 1.3
"""Nothing removed comes nearer to a camera, in plan, than half a car's width and a hand's breadth."""
ROUTE_AHEAD_M = 6.0
"""The way stays free so far beyond the last frame."""
PAINTS = [
    (0.55, 0.56, 0.57), (0.72, 0.72, 0.70), (0.03, 0.03, 0.035), (0.12, 0.13, 0.14), (0.30, 0.31, 0.33), (0.05, 0.10, 0.26), (0.36, 0.025, 0.03),
    (0.05, 0.18, 0.12), (0.48, 0.32, 0.04), (0.18, 0.11, 0.07), (0.10, 0.25, 0.42),
]  # fmt: skip
CLOTHES = [(0.32, 0.06, 0.05), (0.08, 0.22, 0.26), (0.55, 0.30, 0.05), (0.06, 0.06, 0.07), (0.50, 0.48, 0.44), (0.10, 0.12, 0.30), (0.30, 0.33, 0.12)]
LORRIES = [(0.70, 0.70, 0.68), (0.10, 0.20, 0.42), (0.45, 0.05, 0.05), (0.60, 0.42, 0.05), (0.12, 0.30, 0.18)]


class Placer:
    """Keeps the things that find room, and numbers them."""

    def __init__(self, plan: Plan) -> None:
        """``plan``: everything else of the street."""
        self.legs = plan.legs
        self.things: list[Thing] = []
        self.taken: list[Footprint] = []
        self.times = station_times(plan.rig)
        self.centres = np.array([route_at(plan, float(d))[0][:2] for d in station_distances(plan.rig)])
        last = float(station_distances(plan.rig)[-1])
        self.way = np.array([route_at(plan, float(d))[0][:2] for d in np.arange(0.0, last + ROUTE_AHEAD_M, 0.5)])
        self.posts = np.array([leg.path.place(p.s, p.t)[:2] for leg in plan.legs for p in leg.posts]).reshape(-1, 2)

    def put(self, thing: Thing) -> bool:
        """Keep a thing if it is clear of the cameras, of posts and of all that stands there; returns whether it is kept."""
        leg = self.legs[thing.leg]
        if not leg.s0 + 4 < thing.s < leg.s1 - 8:
            return False
        here = footprint(thing, self.legs)
        if thing.speed:
            apart = [footprint(thing, self.legs, t).distance(c) for t, c in zip(self.times, self.centres, strict=True)]
            if min(apart) < CAMERA_ROOM_M:
                return False
            marks = np.linspace(self.times[0], self.times[-1], 12)
            swept = [footprint(thing, self.legs, float(t)) for t in marks]
            if any(f.overlaps(o, 0.1) for f in swept for o in self.taken):
                return False
        else:
            swept = [here]
            if here.distance(self.way) < CAMERA_ROOM_M:
                return False
        if any(f.overlaps(o, 0.25) for f in swept[:1] for o in self.taken) or any(f.distance(self.posts) < 0.35 for f in swept):
            return False
        self.things.append(replace(thing, number=len(self.things) + 1))
        self.taken += swept
        return True


def draw_things(rng: np.random.Generator, plan: Plan, travel: float) -> list[Thing]:
    """Everything that is removed, none of it in the cameras' way."""
    placer = Placer(plan)
    moving = bool(rng.uniform() < 0.4)
    for number, leg in enumerate(plan.legs):
        _big(rng, placer, number, leg, travel)
        _queue(rng, placer, number, leg, travel, moving)
        _parked(rng, placer, number, leg)
        _bicycles(rng, placer, number, leg, travel)
        _people(rng, placer, number, leg, travel, moving)
    return placer.things


def _color(rng: np.random.Generator, colors: list[tuple[float, float, float]]) -> tuple[float, float, float]:
    found = np.clip(np.array(colors[int(rng.integers(0, len(colors)))]) * rng.uniform(0.8, 1.2), 0.01, 0.8)
    return float(found[0]), float(found[1]), float(found[2])


def _ahead(leg: Leg, side: int) -> float:
    """Which way traffic on a side points: along the street on the right and on one-way streets, against it on the left."""
    return 0.0 if side < 0 or leg.section.lanes[1] < 1 and leg.section.lanes[0] < 1 else math.pi


def _parked(rng: np.random.Generator, placer: Placer, number: int, leg: Leg) -> None:
    """Rows of parked vehicles, as dense as the street is full."""
    kinds = [k for k, v in KINDS.items() if v.share]
    shares = np.array([KINDS[k].share for k in kinds])
    for side in (-1, 1):
        strip = leg.section.parking[side > 0]
        full = float(rng.uniform(0.25, 0.95)) if strip else float(rng.choice([0.0, rng.uniform(0.1, 0.5)]))
        if not full:
            continue
        for s0, s1 in leg.spans(side):
            s = s0 + float(rng.uniform(5, 8))
            while s < s1 - 6:
                kind = str(rng.choice(kinds, p=shares / shares.sum()))
                length, width, _ = KINDS[kind].size
                if rng.uniform() < full:
                    middle = leg.section.edge(side) + strip - 0.12 - width / 2 if strip else leg.section.kerb_at(side) - width / 2 + 0.05
                    t = side * (middle - abs(float(rng.normal(0, 0.07))))
                    turn = _ahead(leg, side) + float(rng.normal(0, 0.015)) + (math.pi if rng.uniform() < 0.08 else 0.0)
                    colors = PAINTS if KINDS[kind].label == CAR else LORRIES
                    placer.put(Thing(kind, number, s + length / 2, t, turn, _color(rng, colors), 0))
                s += length + float(rng.uniform(0.6, 1.8))


def _big(rng: np.random.Generator, placer: Placer, number: int, leg: Leg, travel: float) -> None:
    """Lorries and buses: standing at the kerb, or ahead in the lane."""
    for _ in range(int(rng.choice([0, 1, 2], p=[0.4, 0.4, 0.2]))):
        kind = str(rng.choice(["lorry", "articulated lorry", "bus"], p=[0.4, 0.25, 0.35]))
        side = int(rng.choice([-1, 1]))
        width = KINDS[kind].size[1]
        t = side * (leg.section.kerb_at(side) - 0.25 - width / 2)
        s = float(rng.uniform(4, travel + 25))
        placer.put(Thing(kind, number, s, t, _ahead(leg, side), _color(rng, LORRIES), 0))


def _queue(rng: np.random.Generator, placer: Placer, number: int, leg: Leg, travel: float, moving: bool) -> None:
    """Vehicles in the lanes: a standing queue ahead or in the other direction, or, in some streets, moving ones."""
    kinds = ["hatch", "saloon", "suv", "estate", "van"]
    other = 1 if leg.section.lanes[1] >= 1 else -1
    lane = leg.section.lane_width * 0.5
    if rng.uniform() < 0.35:
        s, side = float(rng.uniform(0.3, 1.0)) * travel, other
        for _ in range(int(rng.integers(1, 5))):
            kind = str(rng.choice(kinds))
            placer.put(Thing(kind, number, s, side * lane, _ahead(leg, side), _color(rng, PAINTS), 0))
            s += KINDS[kind].size[0] + float(rng.uniform(1.5, 3.0))
    if rng.uniform() < 0.3:
        kind = str(rng.choice([*kinds, "box van", "bus"]))
        placer.put(Thing(kind, number, travel + float(rng.uniform(10, 16)), -lane, 0.0, _color(rng, PAINTS), 0))
    if moving:
        for _ in range(int(rng.integers(1, 4))):
            kind = str(rng.choice(kinds))
            s, speed = float(rng.uniform(0.3, 1.2)) * travel + 15, float(rng.uniform(4, 11))
            placer.put(Thing(kind, number, s, other * lane, _ahead(leg, other), _color(rng, PAINTS), 0, speed))


def _bicycles(rng: np.random.Generator, placer: Placer, number: int, leg: Leg, travel: float) -> None:
    """Bicycles on the sidewalks, some side by side at a rack."""
    for _ in range(int(rng.integers(0, 4))):
        side = int(rng.choice([-1, 1]))
        if not leg.section.walk[side > 0]:
            continue
        s = float(rng.uniform(2, travel + 20))
        across = rng.uniform() < 0.4
        t = side * (leg.section.back(side) - (1.1 if across else 0.45))
        color = _color(rng, PAINTS)
        for k in range(int(rng.integers(1, 5)) if across else 1):
            turn = side * math.pi / 2 if across else float(rng.choice([0.0, math.pi]))
            if _beside(leg, side, s + 0.7 * k):
                placer.put(Thing("bicycle", number, s + 0.7 * k, t, turn + float(rng.normal(0, 0.06)), color if k == 0 else _color(rng, PAINTS), 0))


def _people(rng: np.random.Generator, placer: Placer, number: int, leg: Leg, travel: float, moving: bool) -> None:
    """People on the sidewalks, alone and in groups, and now and then one on the road."""
    for _ in range(int(rng.integers(1, 9))):
        side = int(rng.choice([-1, 1]))
        walk = leg.section.walk[side > 0]
        s = float(rng.uniform(2, travel + 25))
        if not walk or not _beside(leg, side, s):
            continue
        back = leg.section.back(side)
        for _ in range(int(rng.choice([1, 2, 3], p=[0.65, 0.25, 0.1]))):
            at, t = s + float(rng.uniform(-0.9, 0.9)), side * (back - float(rng.uniform(0.5, max(0.6, walk - 0.4))))
            goes = moving and rng.uniform() < 0.5
            turn = float(rng.choice([0.0, math.pi])) if goes else float(rng.uniform(-math.pi, math.pi))
            placer.put(Thing("person", number, at, t, turn, _color(rng, CLOTHES), 0, float(rng.uniform(0.9, 1.5)) if goes else 0.0))
    if rng.uniform() < 0.3:
        s, t = float(rng.uniform(8, travel + 15)), float(rng.uniform(-1, 1)) * leg.section.kerb_at(1) * 0.8
        placer.put(Thing("person", number, s, t, math.pi / 2, _color(rng, CLOTHES), 0))


def _beside(leg: Leg, side: int, s: float) -> bool:
    """Whether a sidewalk is there."""
    return any(a + 1 < s < b - 1 for a, b in leg.spans(side))
