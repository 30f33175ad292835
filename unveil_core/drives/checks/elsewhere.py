"""Whether points lie where the cameras are, and which usual reading of them brings them there: other axes, another unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.drives.checks.agreement import FEWEST_POINTS, Agreement
from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.checks.points_seen import seen_share
from unveil_core.geometry.camera import Camera

__all__ = ["DOUBTED", "UNSEEN", "among", "points_elsewhere", "points_read_otherwise"]

UNSEEN = 0.02
"""Share of the points that cameras of right poses see at least, where their photographs tell nothing."""
FAR, DOUBTED, NEAR, NEARER = 0.4, 0.08, 0.06, 4.0
"""Distance from what photographs show to the nearest point, as a share of its depth: the least of the pairs' medians beyond which
the points are elsewhere; the median beyond which other readings are tried; of one of these, that at which it is right if it also
is so many times smaller. Of drives that are right it is 0.01 to 0.05, and no other reading of theirs comes nearer than 0.06; of
wrong ones the right reading is 6 to 80 times nearer. In a narrow street that is turned about its axis something is near
everywhere, and 0.1 to 0.3 is usual."""
CLEARLY = 1.5
"""So many times nearer a mirrored reading is than one that is none: streets are much alike on both sides."""
UNITS = {
    0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches", 0.3048: "feet", 1.0: "", 1000.0: "kilometres",
}  # fmt: skip
"""Units that points may be in where poses are in metres, by metres."""
MOST_TRIED = 400
"""Places by which other readings of the points are tried."""


def points_read_otherwise(own: Agreement, tree: cKDTree | None) -> Finding | None:
    """That points lie where the cameras are, if they are taken in a usual other way.

    Args:
        own: of the drive as it was read; tree: of its points.
    """
    if tree is None or own.apart is None or own.apart < DOUBTED:
        return None
    step = max(1, -(-len(own.depth) // MOST_TRIED))
    reading = _other_reading(tree, own.where[::step], own.depth[::step], min(NEAR, own.apart / NEARER))
    if reading is None:
        return None
    problem = f"points lie where the photographs show nothing, and where they show something if {reading}"
    return Finding(problem, "convert the points", asks=True)


def points_elsewhere(cameras: Sequence[Camera], points: Float64, own: Agreement) -> Finding | None:
    """That the points are not where the cameras are.

    Args:
        points: (P, 3) some of the drive's.
        own: of the drive as it was read.
    """
    if len(points) < FEWEST_POINTS or (own.nearest is not None and own.nearest < FAR):
        return None
    away = _distance(cameras, points)
    problem = f"points lie where the photographs show nothing: their middle is {away} from the cameras"
    if own.nearest is None:
        if (seen := seen_share(points, cameras)) >= UNSEEN / 2:
            return None
        problem = f"the cameras see {seen:.1%} of the points, whose middle lies {away} from them"
    return Finding(problem, "points and poses are of different coordinates: export both together", asks=True)


def among(cameras: Sequence[Camera], points: Float64) -> bool:
    """Whether cameras are among the points, or beside them: nearer than these reach."""
    away = cKDTree(points).query(np.stack([c.centre for c in cameras]))[0]
    reach = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return bool(np.median(away) < np.median(reach))


def _distance(cameras: Sequence[Camera], points: Float64) -> str:
    away = float(np.linalg.norm(np.median(points, axis=0) - np.median([c.centre for c in cameras], axis=0)))
    return f"{away:,.0f} units" if away >= 10 else f"{away:.2g} units"


def _other_reading(tree: cKDTree, where: Float64, depth: Float64, most: float) -> str | None:
    """What the points are taken for that lie where the photographs show something; None where nothing usual helps.

    Args:
        tree: of the points as they are; where: (N, 3) places that photographs show; depth: (N,) of these from a camera.
        most: median distance to the nearest point, as a share of the depth, that puts them right.
    """
    best = {False: (most, ""), True: (most, "")}
    for mirrored, turn, axes in _turns():
        for metres, unit in UNITS.items():
            if unit == "" and axes == "":
                continue
            # Turned points R p * s near a place w are points p near R' w / s.
            apart = tree.query(where @ turn / metres)[0] * metres
            relative = float(np.median(apart / depth))
            if relative < best[mirrored][0]:
                said = " and ".join(part for part in (f"they are {unit}" if unit else "", axes) if part)
                best[mirrored] = relative, said
    mirrors = bool(best[True][1]) and (best[True][0] * CLEARLY < best[False][0] or not best[False][1])
    return best[mirrors][1] or None


def _turns() -> Iterator[tuple[bool, Float64, str]]:
    """What brings axes to axes, and what it means: the 24 rotations of a cube, the identity first, and its 24 mirrored ones, which
    left-handed programs make."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            mirrored = bool(np.linalg.det(turn) < 0)
            shown = ", ".join(("" if s > 0 else "-") + "xyz"[k] for s, k in zip(signs, order, strict=True))
            axes = f"their axes are ({shown}) of the poses' (x, y, z)" + (", which mirrors them" if mirrored else "")
            found.append((mirrored, turn, "" if np.array_equal(turn, np.eye(3)) else axes))
    return iter(sorted(found, key=lambda f: f[0]))
