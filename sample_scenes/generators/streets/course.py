"""Draws the course of a street, its cross section, a junction where it has one, and the way that the camera takes."""

from __future__ import annotations

import math

import numpy as np

from sample_scenes.generators.streets.cameras import ROUTE_STEP_M
from sample_scenes.generators.streets.path import bend_curvature, corner_curve, crest, swept
from sample_scenes.generators.streets.plan import Corner, Leg, Section

COURSES = {"straight": 0.24, "bend": 0.30, "S": 0.18, "junction": 0.28}
"""How often each course is drawn."""
LEAST_RADIUS_M = 34.0
"""No bend is tighter: what stands up to 25 m inside of it still has room. Tighter turns are junctions."""
BEHIND_M, AHEAD_M = 22.0, 85.0
"""How much street there is behind the first and before the last frame."""
CORNER_RADIUS_M = (4.0, 7.0)
LEAST_TURN_M = 5.5
"""The kerb around which the camera turns is rounded at least so far, metres: cars do not turn tighter by much."""
KERB_ROOM_M = 1.35
"""The camera stays so far from a kerb that it turns around, metres: half a car's width, and some."""


def draw_section(rng: np.random.Generator, character: str) -> Section:
    """A cross section: 1 to 4 lanes."""
    one_way = rng.uniform() < 0.25
    width = float(rng.uniform(2.8, 3.6))
    if one_way:
        half = 0.5 * float(rng.choice([1, 2], p=[0.55, 0.45]))
        lanes = (half, half)
        width = max(width, 3.3) if half == 0.5 else width
    else:
        each = float(rng.choice([1, 2], p=[0.85, 0.15]))
        lanes = (each, each)
    strips = [float(rng.uniform(1.95, 2.3)) if rng.uniform() < 0.7 else 0.0 for _ in range(2)]
    verge = [float(rng.uniform(0.8, 2.2)) if rng.uniform() < (0.15 if character == "town" else 0.5) else 0.0 for _ in range(2)]
    walk = [float(rng.uniform(1.6, 4.2)) for _ in range(2)]
    if character == "edge" and rng.uniform() < 0.6:
        walk[int(rng.integers(0, 2))] = 0.0
    verge = [max(v, 1.5) if w == 0 else v for v, w in zip(verge, walk, strict=True)]
    pavement = "cobbles" if rng.uniform() < 0.16 else "asphalt"
    return Section(
        lanes=lanes, lane_width=width, parking=(strips[0], strips[1]), verge=(verge[0], verge[1]), walk=(walk[0], walk[1]),
        kerb=float(rng.uniform(0.06, 0.15)), crown=float(rng.uniform(0.02, 0.07)), pavement=pavement,
        tram=bool(rng.uniform() < 0.18), bays=bool(rng.uniform() < 0.6), edge_line=bool(rng.uniform() < 0.45 and pavement == "asphalt"),
        centre=str(rng.choice(["none", "dashes", "solid"], p=[0.25, 0.55, 0.2])) if not one_way and pavement == "asphalt" else "none",
    )  # fmt: skip


def route_offset(section: Section) -> float:
    """t of the camera's way: the middle of the rightmost lane, nearer to the middle where that lane is all there is."""
    if section.lanes[1] in (0.5,):
        return 0.0
    return -section.edge(-1) + section.lane_width * 0.5


def single(rng: np.random.Generator, kind: str, travel: float, section: Section) -> tuple[dict[str, float | str], Leg]:
    """One street: straight, with a bend or with two opposite ones."""
    grade = float(rng.choice([0.0, rng.uniform(-0.06, 0.06)], p=[0.3, 0.7]))
    height = float(rng.choice([0.0, rng.uniform(-1.2, 1.6)], p=[0.45, 0.55]))
    # A crest's sharpest curvature is 2 height / width²: 250 m of radius at least.
    width = max(18.0, math.sqrt(2 * abs(height) * 250.0))
    top = float(rng.uniform(0.3, 0.9)) * travel
    side = float(rng.choice([-1.0, 1.0]))
    bends: list[tuple[float, float, float]] = []
    if kind == "bend":
        bends = [(float(rng.uniform(-0.2, 0.4)) * travel, side * math.radians(rng.uniform(15, 75)), float(rng.uniform(LEAST_RADIUS_M, 110)))]
    elif kind == "S":
        turn, radius = math.radians(rng.uniform(12, 40)), float(rng.uniform(LEAST_RADIUS_M, 80))
        start = float(rng.uniform(-0.1, 0.25)) * travel
        bends = [(start, side * turn, radius), (start + turn * radius + 22.0, -side * math.radians(rng.uniform(12, 40)), radius)]

    def curvature(s: np.ndarray) -> np.ndarray:
        return sum((bend_curvature(s, *b) for b in bends), np.zeros_like(s))

    s0, s1 = -BEHIND_M, travel + AHEAD_M
    path = swept(s0, s1, curvature, lambda s: crest(s, grade, top, height, width))
    course: dict[str, float | str] = {
        "kind": kind, "turn_degrees": round(math.degrees(sum(b[1] for b in bends)), 1), "grade": round(grade, 4), "crest_m": round(height, 2),
        "radius_m": round(min((b[2] for b in bends), default=0.0), 1),
    }  # fmt: skip
    return course, Leg(path, section, s0, s1)


def route_along(leg: Leg, offset: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """The camera's way (D, 3) on the road and its headings (D,), at a constant offset; distances count along the street."""
    s = np.arange(int(length / ROUTE_STEP_M) + 1) * ROUTE_STEP_M
    return leg.path.place(s, offset, leg.section.height(offset)), leg.path.heading(s)


def junction(
    rng: np.random.Generator, travel: float, first: Section, second: Section
) -> tuple[dict[str, float | str], list[Leg], list[Corner], np.ndarray, np.ndarray]:
    """Two straight streets that cross on a slightly tilted plane, and the way around one corner."""
    angle = math.radians(float(rng.uniform(76, 90))) * float(rng.choice([-1.0, 1.0]))
    grade = float(rng.uniform(-0.03, 0.03))
    meet = float(rng.uniform(0.4, 0.65)) * travel
    u, v = np.array([1.0, 0.0]), np.array([math.cos(angle), math.sin(angle)])
    centre = meet * u
    s0, s1 = -BEHIND_M, meet + AHEAD_M
    b0, b1 = -60.0, travel - meet + AHEAD_M
    a = swept(s0, s1, np.zeros_like, lambda s: grade * s)
    b = swept(
        b0, b1, np.zeros_like, lambda s: grade * (meet + s * math.cos(angle)), origin=centre, angle=angle, tilt=-grade * math.sin(angle)
    )
    inner = -1 if angle < 0 else 1
    inner_radius = 0.0
    corners, cuts_a, cuts_b = [], {-1: [0.0, 0.0], 1: [0.0, 0.0]}, {-1: [0.0, 0.0], 1: [0.0, 0.0]}
    na, nb = np.array([-u[1], u[0]]), np.array([-v[1], v[0]])

    def lines_meet(along_a: float, along_b: float) -> np.ndarray:
        """Where the line at an offset of the first street meets the one at an offset of the second."""
        k = (along_b - along_a * (na @ nb)) / (u @ nb)
        return centre + k * u + along_a * na

    for side_a in (-1, 1):
        for side_b in (-1, 1):
            away_a = side_b * math.copysign(1, u @ nb) * u
            away_b = side_a * math.copysign(1, v @ na) * v
            tip = lines_meet(side_a * first.kerb_at(side_a), side_b * second.kerb_at(side_b))
            radius = float(rng.uniform(*CORNER_RADIUS_M))
            if (side_a, side_b) == (inner, inner):
                radius = inner_radius = max(radius, LEAST_TURN_M)
            # Walking along the kerb: towards the tip on one street, away from it on the other.
            arc, length, _ = corner_curve(tip + 20 * away_a, -away_a, tip, away_b, radius)
            back = lines_meet(side_a * first.back(side_a), side_b * second.back(side_b))
            end_a, end_b = tip + length * away_a, tip + length * away_b
            wide_a, wide_b = first.back(side_a) - first.kerb_at(side_a), second.back(side_b) - second.kerb_at(side_b)
            corners.append(Corner(
                tuple(map(tuple, arc.tolist())),
                tuple(map(tuple, [(end_b + side_b * nb * wide_b).tolist(), back.tolist(), (end_a + side_a * na * wide_a).tolist()])),
                tuple(tip.tolist()),
            ))  # fmt: skip
            cuts_a[side_a][int(away_a @ u > 0)] = meet + float((end_a - centre) @ u)
            cuts_b[side_b][int(away_b @ v > 0)] = float((end_b - centre) @ v)
    legs = [
        Leg(a, first, s0, s1, (tuple(cuts_a[-1]), tuple(cuts_a[1]))),
        Leg(b, second, b0, b1, (tuple(cuts_b[-1]), tuple(cuts_b[1]))),
    ]
    # The way: along the first lane, around, along the second; a right turn is tight, a left one wide.
    lane_a, lane_b = route_offset(first), route_offset(second)
    radius = float(rng.uniform(7.5, 9.0)) if angle < 0 else float(rng.uniform(9.0, 12.0))
    # Between the inner kerb and the camera, at the apex of the turn: room / c - (1 / c - 1) (radius - inner radius).
    room = min(abs(inner * first.kerb_at(inner) - lane_a), abs(inner * second.kerb_at(inner) - lane_b))
    c = math.cos(abs(angle) / 2)
    radius = max(LEAST_TURN_M + 0.5, min(radius, inner_radius + (room / c - KERB_ROOM_M) / (1 / c - 1)))
    arc, before, along = corner_curve(lane_a * na, u, centre + lane_b * nb, v, radius)
    start = np.arange(0, along - before, ROUTE_STEP_M)[:, None] * u + lane_a * na
    rest = np.arange(ROUTE_STEP_M, travel + 30.0, ROUTE_STEP_M)[:, None] * v + arc[-1]
    xy = np.concatenate([start, arc, rest])
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    even = np.arange(0.0, travel + 12.0, ROUTE_STEP_M)
    xy = np.stack([np.interp(even, gone, xy[:, k]) for k in range(2)], axis=1)
    heading = np.unwrap(np.arctan2(*np.gradient(xy, axis=0).T[::-1]))
    kernel = np.ones(13) / 13
    heading = np.convolve(np.pad(heading, 6, mode="edge"), kernel, mode="valid")
    route = np.concatenate([xy, grade * xy[:, :1]], axis=1)
    course: dict[str, float | str] = {
        "kind": "junction", "turn_degrees": round(math.degrees(angle), 1), "grade": round(grade, 4), "crest_m": 0.0, "radius_m": round(radius, 1),
        "meet_m": round(meet, 1),
    }  # fmt: skip
    return course, legs, corners, route, heading
