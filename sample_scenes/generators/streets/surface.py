"""Builds the carriageway with what lies on it, kerbs, sidewalks, verges, the ground beyond, and the plate of a junction."""

from __future__ import annotations

import numpy as np

from sample_scenes.generators.streets.mesh import Builder, stations
from sample_scenes.generators.streets.path import Path
from sample_scenes.generators.streets.plan import ROAD, SIDEWALK, TERRAIN, Corner, Leg, Mark, Plan

LIFT_M = {"patch old": 0.003, "patch new": 0.005, "manhole": 0.009}
"""How far marks lie over the asphalt, metres; paint lies over patches. Less is no gap to the eye, and none may coincide."""
PAINT_LIFT_M = 0.007
TERRAIN_M = 60.0
SECOND_LEG_M = -0.004
"""The second street's asphalt lies so much lower: where two streets cross, the first one's is seen."""


def build_surface(builder: Builder, plan: Plan) -> None:
    """All ground."""
    for number, leg in enumerate(plan.legs):
        _carriageway(builder, leg, SECOND_LEG_M * number)
        for side in (-1, 1):
            for s0, s1 in leg.spans(side):
                _beside(builder, leg, side, s0, s1, terrain=not plan.corners)
        for mark in leg.marks:
            _mark(builder, leg, mark, SECOND_LEG_M * number)
    for corner in plan.corners:
        _corner(builder, plan.legs[0], corner)
    _far_ground(builder, plan)


def _patch(builder: Builder, material: str, label: int, leg: Leg, s: tuple[float, float], t: tuple[float, float], lift: float) -> None:
    """A piece of the carriageway's own surface, lifted."""
    along = stations(*s)
    ts, hs = leg.section.profile()
    across = np.unique(np.concatenate([[t[0], t[1]], ts[(ts > t[0]) & (ts < t[1])]]))
    points = leg.path.place(along[:, None], across[None], np.interp(across, ts, hs)[None] + lift)
    builder.grid(material, label, points, np.stack(np.broadcast_arrays(along[:, None], across[None]), axis=-1))


def _carriageway(builder: Builder, leg: Leg, lift: float) -> None:
    section = leg.section
    right, left = -section.kerb_at(-1), section.kerb_at(1)
    _patch(builder, section.pavement, ROAD, leg, (leg.s0, leg.s1), (right, left), lift)
    for s0, s1 in leg.open_spans():
        for side in (-1, 1):
            if section.walk[side > 0]:
                ends = sorted((side * section.kerb_at(side), side * (section.kerb_at(side) - 0.3)))
                _patch(builder, "gutter", ROAD, leg, (s0, s1), (ends[0], ends[1]), lift + 0.002)
    if section.tram and not leg.cuts[0]:
        middle = (right + left) / 2
        for t in (-2.25, -0.81, 0.81, 2.25):
            if right + 0.5 < middle + t < left - 0.5:
                _patch(builder, "rail", ROAD, leg, (leg.s0, leg.s1), (middle + t - 0.035, middle + t + 0.035), lift + 0.0075)


def _beside(builder: Builder, leg: Leg, side: int, s0: float, s1: float, *, terrain: bool) -> None:
    """Kerb, verge, sidewalk and the ground behind, from the kerb outwards."""
    section, h = leg.section, leg.section.kerb
    kerb = section.kerb_at(side)

    def sweep(material: str, label: int, profile: list[tuple[float, float]]) -> None:
        builder.sweep(material, label, leg, s0, s1, [(side * t, z) for t, z in profile])

    sweep("kerb", SIDEWALK, [(kerb, -0.03), (kerb, h - 0.015), (kerb + 0.015, h), (kerb + 0.15, h)])
    at, verge, walk = kerb + 0.15, section.verge[side > 0], section.walk[side > 0]
    if verge > 0.4:
        sweep("grass", TERRAIN, [(at, h), (at + 0.1, h + 0.02), (kerb + verge, h + 0.02), (kerb + verge, h)])
        at = kerb + verge
    if walk:
        sweep("walk", SIDEWALK, [(at, h), (section.back(side), h + 0.02)])
    if terrain:
        _terrain(builder, leg, side, s0, s1)


def reach(path: Path, s: float, side: int, far: float) -> float:
    """How far to a side the ground can be swept before the inside of a bend folds."""
    bend = path.bend(s) * side
    return far if bend <= 0 else min(far, 0.75 / bend)


def _terrain(builder: Builder, leg: Leg, side: int, s0: float, s1: float) -> None:
    s = stations(s0, s1)[::4]
    s = np.append(s, s1)
    back, h = leg.section.back(side), leg.section.kerb
    far = np.array([max(back + 1.0, reach(leg.path, float(v), side, TERRAIN_M)) for v in s])
    # A bend's ends would make the border jump: the least of what lies around counts.
    far = np.array([far[max(0, i - 12) : i + 13].min() for i in range(len(far))])
    share = np.linspace(0, 1, 7) ** 2
    t = back + (far - back)[:, None] * share[None]
    points = leg.path.place(s[:, None], side * t, h - 0.02 - 0.004 * (t - back))
    builder.grid("meadow", TERRAIN, points)


def _far_ground(builder: Builder, plan: Plan) -> None:
    """One wide plane: right under a junction's streets, else below the lowest place."""
    path = plan.legs[0].path
    middle = path.place(float(path.s.mean()), 0.0)
    if plan.corners:
        grade = path.grade(0.0)
        low, slope = path.place(0.0, 0.0)[2] - 0.05, grade
        middle = path.place(0.0, 0.0)
    else:
        low, slope = float(path.z.min()) - 1.2, 0.0
    corners = np.array([(-350, -350), (350, -350), (350, 350), (-350, 350)], float)
    points = np.concatenate([corners + middle[:2], np.zeros((4, 1))], axis=1)
    points[:, 2] = low + slope * (points[:, 0] - middle[0])
    builder.add("meadow", TERRAIN, points, [(0, 1, 2, 3)])


def _mark(builder: Builder, leg: Leg, mark: Mark, lift: float) -> None:
    if mark.kind == "manhole":
        a = np.linspace(0, 2 * np.pi, 25)[:-1]
        s, t = (mark.s0 + mark.s1) / 2 + 0.32 * np.cos(a), (mark.t0 + mark.t1) / 2 + 0.32 * np.sin(a)
        ts, hs = leg.section.profile()
        h = float(np.interp((mark.t0 + mark.t1) / 2, ts, hs)) + LIFT_M["manhole"] + lift
        builder.add("iron", ROAD, leg.path.place(s, t, h), [tuple(range(24))])
        return
    material = mark.kind if mark.kind.startswith("patch") else "paint"
    _patch(builder, material, ROAD, leg, (mark.s0, mark.s1), (mark.t0, mark.t1), LIFT_M.get(mark.kind, PAINT_LIFT_M) + lift)


def _corner(builder: Builder, leg: Leg, corner: Corner) -> None:
    """The rounded corner of a block: asphalt up to the kerb's arc, the kerb, and the sidewalk behind."""
    arc, back, tip = (np.array(p) for p in (corner.arc, corner.back, corner.tip))
    grade, h = leg.path.grade(0.0), leg.section.kerb

    def at(xy: np.ndarray, lift: float) -> np.ndarray:
        xy = np.atleast_2d(xy)
        return np.concatenate([xy, leg.path.z[np.argmin(np.abs(leg.path.s))] + grade * xy[:, :1] + lift], axis=1)

    uv = np.concatenate([arc, tip[None]])
    builder.add(leg.section.pavement, ROAD, at(uv, -0.002), [tuple(range(len(uv)))], uv)
    face = np.stack([at(arc, -0.03), at(arc, h)], axis=1)
    builder.grid("kerb", SIDEWALK, face)
    block = np.concatenate([arc, back])
    builder.add("walk", SIDEWALK, at(block, h), [tuple(range(len(block)))], block)
