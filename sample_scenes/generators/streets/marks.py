"""Draws what lies flat on the carriageway: paint, patches of newer and older asphalt, manhole covers."""

from __future__ import annotations

import numpy as np

from sample_scenes.generators.streets.plan import Leg, Mark

LINE_M = 0.12
"""Width of a painted line, metres."""


def draw_marks(rng: np.random.Generator, leg: Leg, travel: float) -> list[Mark]:
    """All marks of a street, along it from end to end."""
    section = leg.section
    found: list[Mark] = []
    spans = leg.open_spans()
    for s0, s1 in spans:
        found += _along(leg, s0, s1)
    crossings = []
    if len(spans) == 2:
        for end, way in ((spans[0][1], -1), (spans[1][0], 1)):
            if rng.uniform() < 0.6:
                crossings.append(end + way * 1.0 if way > 0 else end - 4.5)
            if rng.uniform() < 0.7:
                at = end + way * 5.0
                t0, t1 = (-section.edge(-1), -0.1) if way < 0 else (0.1, section.edge(1))
                found.append(Mark("stop line", at, at + 0.4, t0, t1))
    elif rng.uniform() < 0.55:
        crossings.append(float(rng.uniform(0.2, 1.1)) * travel + 6.0)
        if rng.uniform() < 0.5:
            found.append(Mark("stop line", crossings[-1] - 1.6, crossings[-1] - 1.2, -section.edge(-1), -0.1))
    for s in crossings:
        t = -section.edge(-1) + 0.25
        while t + 0.5 <= section.edge(1):
            found.append(Mark("zebra", s, s + 3.5, t, t + 0.5))
            t += 1.0
    # Paint along the street ends before paint across it.
    found = [m for m in found if m.kind not in ("line", "dash") or not any(m.s1 > c - 0.3 and m.s0 < c + 3.8 for c in crossings)]
    kerbs = -section.kerb_at(-1), section.kerb_at(1)
    for kind, count in (("patch new", rng.integers(1, 6)), ("patch old", rng.integers(1, 6))):
        for _ in range(int(count)):
            s, t = float(rng.uniform(leg.s0 + 10, leg.s1 - 30)), float(rng.uniform(kerbs[0] + 0.3, kerbs[1] - 1.6))
            long, wide = (float(rng.uniform(3, 18)), float(rng.uniform(0.5, 1.1))) if rng.uniform() < 0.5 else rng.uniform((1.0, 0.8), (4.0, 2.2))
            patch = Mark(kind, s, s + float(long), t, min(t + float(wide), kerbs[1] - 0.25))
            # Two patches of one age lie at one height: they must not overlap.
            if not any(m.kind == kind and m.s0 < patch.s1 and m.s1 > patch.s0 and m.t0 < patch.t1 and m.t1 > patch.t0 for m in found):
                found.append(patch)
    for _ in range(int(rng.integers(2, 8))):
        s, t = float(rng.uniform(0, travel + 40)), float(rng.uniform(kerbs[0] + 0.6, kerbs[1] - 0.6))
        found.append(Mark("manhole", s - 0.32, s + 0.32, t - 0.32, t + 0.32))
    inside = [c for c in leg.cuts if c is not None]
    if section.pavement == "cobbles":
        found = [m for m in found if m.kind in ("manhole", "zebra")]
    return [m for m in found if not any(m.s0 < c[1] and m.s1 > c[0] for c in inside) and m.s0 > leg.s0 and m.s1 < leg.s1]


def _along(leg: Leg, s0: float, s1: float) -> list[Mark]:
    """Lines and bay marks of a stretch."""
    section = leg.section
    found: list[Mark] = []
    pieces = [(s, min(s + 4.0, s1 - 0.2)) for s in np.arange(s0 + 0.3, s1 - 1.0, 4.0)]
    for side in (-1, 1):
        edge, kerb = section.edge(side), section.kerb_at(side)
        if section.edge_line and section.parking[side > 0]:
            inner = sorted((side * (edge - 0.02), side * (edge - 0.02 - LINE_M)))
            found += [Mark("line", a, b, inner[0], inner[1]) for a, b in pieces]
        if section.bays and section.parking[side > 0]:
            across = sorted((side * (edge + 0.1), side * (kerb - 0.15)))
            found += [Mark("bay", float(s), float(s) + 0.1, across[0], across[1]) for s in np.arange(s0 + 2.0, s1 - 1.0, 5.6)]
    if section.centre == "solid":
        found += [Mark("line", a, b, -LINE_M / 2, LINE_M / 2) for a, b in pieces]
    elif section.centre == "dashes":
        found += [Mark("dash", float(s), min(float(s) + 2.5, s1), -LINE_M / 2, LINE_M / 2) for s in np.arange(s0 + 1, s1 - 3, 6.0)]
    for side in (-1, 1):
        if section.lanes[side > 0] == 2 and section.pavement == "asphalt":
            t = side * section.lane_width
            found += [Mark("dash", float(s), float(s) + 1.5, t - LINE_M / 2, t + LINE_M / 2) for s in np.arange(s0 + 1, s1 - 3, 5.0)]
    return found
