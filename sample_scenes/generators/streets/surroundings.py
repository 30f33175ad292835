"""Draws what stands beside the street: houses and gardens lot by lot, trees, lamps, signs and poles."""

from __future__ import annotations

import math

import numpy as np

from sample_scenes.generators.streets.plan import Leg, Lot, Post

STYLES = {
    "town": {"plaster": 0.34, "brick": 0.26, "shop": 0.24, "office": 0.1, "gap": 0.06},
    "suburb": {"house": 0.62, "brick": 0.08, "plaster": 0.08, "garden": 0.14, "wall": 0.08},
    "edge": {"garden": 0.34, "hedge": 0.22, "house": 0.22, "wall": 0.10, "hall": 0.12},
}
"""Which styles a kind of street has, and how often."""
PLASTERS = [
    (0.62, 0.41, 0.16), (0.68, 0.61, 0.47), (0.58, 0.32, 0.26), (0.42, 0.44, 0.45), (0.30, 0.40, 0.50), (0.66, 0.64, 0.60), (0.45, 0.50, 0.38),
    (0.70, 0.52, 0.36),
]  # fmt: skip
BRICKS = [(0.36, 0.13, 0.075), (0.55, 0.47, 0.36), (0.28, 0.12, 0.10), (0.42, 0.24, 0.14)]
TREE_CLEAR_M = 4.0
"""Trees and lamps keep so far from each other along the street."""


def draw_lots(rng: np.random.Generator, leg: Leg, character: str) -> list[Lot]:
    """Lots side by side along both sides, leaving room where two streets' houses would meet."""
    found = []
    styles, weights = zip(*STYLES[character].items(), strict=True)
    for side in (-1, 1):
        for number, (s0, s1) in enumerate(leg.spans(side)):
            s = s0 + (2.5 if number == 1 else 0.0)
            end = s1 - (2.5 if leg.cuts[side > 0] is not None and number == 0 else 0.0)
            while end - s > 5.0:
                style = str(rng.choice(styles, p=np.array(weights) / sum(weights)))
                width = min(float(rng.uniform(*{"hall": (18, 30), "office": (14, 26), "hedge": (8, 20), "house": (9, 13)}.get(style, (7, 14)))), end - s)
                if end - s - width < 5.0:
                    width = end - s
                floors = {"house": 2, "hall": 2, "office": int(rng.integers(3, 6))}.get(style, int(rng.integers(2, 5)))
                setback = float(rng.uniform(3.0, 7.0)) if style in ("house", "hall") else 0.0
                front = str(rng.choice(["hedge", "fence", "low wall", "open"])) if style in ("house", "garden", "hall") else "none"
                palette = BRICKS if style == "brick" else PLASTERS
                color = np.clip(np.array(palette[int(rng.integers(0, len(palette)))]) * rng.uniform(0.8, 1.15), 0, 0.9)
                found.append(Lot(side, s, s + width, style, floors, setback, front, tuple(color.tolist()), int(rng.integers(0, 1 << 30))))
                s += width + (float(rng.uniform(1.2, 3.0)) if rng.uniform() < 0.15 else 0.0)
    return found


def draw_posts(rng: np.random.Generator, leg: Leg, character: str, lit: bool) -> list[Post]:
    """Trees in verges and sidewalks, lamps in a row, signs, poles, bollards, bins; none on a junction."""
    section = leg.section
    found: list[Post] = []
    lamp_side = int(rng.choice([-1, 1]))
    spacing = float(rng.uniform(16, 32))
    trees = float(rng.choice([0.0, rng.uniform(7, 20)], p=[0.3, 0.7]))
    for side in (-1, 1):
        kerb, back = section.kerb_at(side), section.back(side)
        near = side * (kerb + min(0.55, (back - kerb) / 2))
        planted = side * (kerb + (section.verge[side > 0] / 2 if section.verge[side > 0] > 0.8 else 0.8))
        for s0, s1 in leg.spans(side):
            if side == lamp_side or lit:
                found += [Post("lamp", float(s), near) for s in np.arange(s0 + 3 + spacing / 3, s1 - 2, spacing)]
            if trees and (section.verge[side > 0] > 0.8 or section.walk[side > 0] > 2.3):
                for s in np.arange(s0 + 3, s1 - 3, trees):
                    found.append(Post("tree", float(s + rng.uniform(-1, 1)), planted, float(rng.uniform(0.7, 1.25)), int(rng.integers(0, 1 << 30))))
            for kind, rate in (("sign", 0.03), ("bollard", 0.015), ("bin", 0.012), ("cabinet", 0.008), ("pole", 0.02 if character != "town" else 0.006)):
                for _ in range(int(rng.poisson(rate * (s1 - s0)))):
                    t = near if kind != "cabinet" else side * (back - 0.35)
                    found.append(Post(kind, float(rng.uniform(s0 + 2, s1 - 2)), t, 1.0, int(rng.integers(0, 1 << 30))))
    cuts = [c for c in leg.cuts if c is not None]
    if cuts and rng.uniform() < 0.7:
        for side, s in ((-1, cuts[0][0] - 1.5), (1, cuts[1][1] + 1.5)):
            found.append(Post("traffic light", s, side * (section.kerb_at(side) + 0.4)))
    kept: list[Post] = []
    order = ("traffic light", "lamp", "tree")
    for post in sorted(found, key=lambda p: order.index(p.kind) if p.kind in order else 9):
        room = TREE_CLEAR_M if post.kind == "tree" else 1.2
        if leg.s0 < post.s < leg.s1 and all(math.hypot(post.s - k.s, post.t - k.t) > room for k in kept):
            kept.append(post)
    return kept
