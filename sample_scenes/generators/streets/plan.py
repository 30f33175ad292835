"""What a street is made of, as it was drawn: plain numbers, without Blender. ``street.json`` is this, written down."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sample_scenes.generators.streets.path import Path

ROAD, SIDEWALK, BUILDING, WALL, FENCE, POLE, LIGHT, SIGN, VEGETATION, TERRAIN, SKY = range(11)
PERSON, RIDER, CAR, TRUCK, BUS, BICYCLE = 11, 12, 13, 14, 15, 18
"""Cityscapes trainIds."""
CLASS_NAMES = {PERSON: "person", CAR: "car", TRUCK: "truck", BUS: "bus", BICYCLE: "bicycle"}


@dataclass(frozen=True)
class Kind:
    """Attributes: label: trainId; size: length, width, height in metres; share: how often it parks, against the others."""

    label: int
    size: tuple[float, float, float]
    share: float


KINDS = {
    "hatch": Kind(CAR, (3.95, 1.76, 1.50), 0.30),
    "saloon": Kind(CAR, (4.65, 1.82, 1.45), 0.22),
    "estate": Kind(CAR, (4.70, 1.82, 1.50), 0.15),
    "suv": Kind(CAR, (4.55, 1.88, 1.70), 0.18),
    "van": Kind(CAR, (5.10, 1.95, 2.05), 0.10),
    "box van": Kind(TRUCK, (6.90, 2.20, 3.10), 0.05),
    "lorry": Kind(TRUCK, (9.60, 2.50, 3.70), 0.0),
    "articulated lorry": Kind(TRUCK, (17.0, 2.55, 3.95), 0.0),
    "bus": Kind(BUS, (12.0, 2.55, 3.10), 0.0),
    "bicycle": Kind(BICYCLE, (1.75, 0.50, 1.05), 0.0),
    "person": Kind(PERSON, (0.40, 0.60, 1.80), 0.0),
}
"""Everything that is removed. Sizes are those of common vehicles; the longest lorry is near the 18 m that roads allow."""


@dataclass(frozen=True)
class Section:
    """A street across. Pairs are (right, left); widths in metres.

    Attributes:
        lanes: lanes to either side of t = 0; lane_width; parking: width of the parking strips, 0 for none.
        verge: of grass between kerb and sidewalk; walk: of the sidewalk, 0 for none; kerb: its height; crown: rise of the middle.
        pavement: "asphalt" or "cobbles"; tram: whether rails lie in it; bays: whether the parking strips' bays are marked.
        edge_line, centre: paint: "none", "dashes" or "solid" in the middle.
    """

    lanes: tuple[float, float]
    lane_width: float
    parking: tuple[float, float]
    verge: tuple[float, float]
    walk: tuple[float, float]
    kerb: float
    crown: float
    pavement: str
    tram: bool
    bays: bool
    edge_line: bool
    centre: str

    def edge(self, side: int) -> float:
        """Distance of the lanes' edge from t = 0; ``side`` is 1 for left, -1 for right."""
        return self.lanes[side > 0] * self.lane_width

    def kerb_at(self, side: int) -> float:
        """Distance of the kerb."""
        return self.edge(side) + self.parking[side > 0]

    def back(self, side: int) -> float:
        """Distance of the border of what belongs to the street: facades and gardens begin there."""
        return self.kerb_at(side) + self.verge[side > 0] + self.walk[side > 0]

    def profile(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets and heights of the carriageway, from right to left, between which it is even."""
        right, left = self.kerb_at(-1), self.kerb_at(1)
        t = np.array([-right, -right / 2, 0.0, left / 2, left])
        return t, self.crown * np.array([0.0, 0.65, 1.0, 0.65, 0.0])

    def height(self, t: float) -> float:
        """Of the carriageway or, beyond the kerb, of the sidewalk."""
        if -self.kerb_at(-1) <= t <= self.kerb_at(1):
            return float(np.interp(t, *self.profile()))
        return self.kerb


@dataclass(frozen=True)
class Lot:
    """What stands beside the street between s0 and s1: a facade style, its floors and setback, and what bounds its front."""

    side: int
    s0: float
    s1: float
    style: str
    floors: int
    setback: float
    front: str
    color: tuple[float, float, float]
    key: int


@dataclass(frozen=True)
class Post:
    """Something slender that stays: a tree, lamp, sign, pole, traffic light, bollard or bin; ``size`` scales it."""

    kind: str
    s: float
    t: float
    size: float = 1.0
    key: int = 0


@dataclass(frozen=True)
class Mark:
    """Something flat on the carriageway: "zebra", "stop line", "dash", "line", "bay", "patch new", "patch old", "manhole"."""

    kind: str
    s0: float
    s1: float
    t0: float
    t1: float


@dataclass(frozen=True, eq=False)
class Leg:
    """A street with its course; ``cuts`` are the (s0, s1) on the (right, left) side that a junction takes out of kerb and lots."""

    path: Path
    section: Section
    s0: float
    s1: float
    cuts: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)
    lots: list[Lot] = field(default_factory=list)
    posts: list[Post] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)

    def spans(self, side: int) -> list[tuple[float, float]]:
        """Where kerb, sidewalk and lots are on a side."""
        cut = self.cuts[side > 0]
        return [(self.s0, self.s1)] if cut is None else [(self.s0, cut[0]), (cut[1], self.s1)]

    def open_spans(self) -> list[tuple[float, float]]:
        """Where both sides are: paint along the street ends at a junction."""
        cuts = [c for c in self.cuts if c is not None]
        if not cuts:
            return [(self.s0, self.s1)]
        return [(self.s0, min(c[0] for c in cuts)), (max(c[1] for c in cuts), self.s1)]


@dataclass(frozen=True)
class Corner:
    """The rounded corner of a block at a junction: (M, 2) points of the kerb's arc; where facades meet; where both kerbs would."""

    arc: tuple[tuple[float, float], ...]
    back: tuple[tuple[float, float], ...]
    tip: tuple[float, float]


@dataclass(frozen=True)
class Thing:
    """What is removed. ``turn`` counts from the leg's heading, radians; ``speed`` along where it points, m/s."""

    kind: str
    leg: int
    s: float
    t: float
    turn: float
    color: tuple[float, float, float]
    number: int
    speed: float = 0.0

    def at(self, time: float) -> tuple[float, float]:
        """(s, t) at a time, seconds: it moves along the street or, turned across, over it."""
        way = self.speed * time
        return self.s + way * float(np.cos(self.turn)), self.t + way * float(np.sin(self.turn))


@dataclass(frozen=True)
class Light:
    """Attributes:
    kind: "sun", "overcast" or "dusk"; elevation, azimuth: of the sun, degrees; sun, sky: strengths; clouds: share of the sky.
    brightness: mean level (of 1, in sRGB) that the exposure aims at; drift: of the exposure from frame to frame, stops, 0 for none.
    """

    kind: str
    elevation: float
    azimuth: float
    sun: float
    sky: float
    clouds: float
    brightness: float
    drift: float


@dataclass(frozen=True)
class Rig:
    """Attributes:
    cameras: (name, yaw in degrees) of each; height, metres; fov: degrees across; pitch: degrees down; step: metres between frames.
    speed: m/s between frames; offset: t of the route; stations: places; halt: (first, last) station of a stop at lights, or None.
    width, height_px: of the images.
    """

    cameras: tuple[tuple[str, float], ...]
    height: float
    fov: float
    pitch: float
    step: float
    speed: float
    offset: float
    stations: int
    halt: tuple[int, int] | None
    width: int
    height_px: int


@dataclass(frozen=True)
class Scanner:
    """LiDAR: ``beams`` (0: none, points are those of structure from motion), from ``low`` to ``high`` degrees, noise in metres."""

    beams: int
    low: float
    high: float
    noise: float


@dataclass(frozen=True)
class LabelNoise:
    """How wrong labels are: pixels that borders are off by; specks a frame; chance that an object is missed in a frame."""

    border: float
    specks: float
    missed: float


@dataclass(frozen=True, eq=False)
class Plan:
    """A whole street as it was drawn."""

    seed: int
    course: dict[str, float | str]
    character: str
    wear: dict[str, float]
    legs: list[Leg]
    corners: list[Corner]
    route_xyz: np.ndarray
    route_angle: np.ndarray
    light: Light
    rig: Rig
    scanner: Scanner
    noise: LabelNoise | None
    things: list[Thing]
