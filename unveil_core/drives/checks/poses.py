"""Whether poses, points and photographs can be of one place; and the usual mistakes where they cannot.

Matrices are meant otherwise than the format says, points are in other coordinates or another unit. Photographs tell it best
(``matches``): what two of them show both must lie before both, and where it lies there must be points. Where they show too little
in common, how many points the cameras see must do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.drive_options import POSE_CONVENTIONS
from unveil_core.base.types import Float64
from unveil_core.drives.checks.conventions import OPENCV, OPENGL, in_convention
from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.checks.matches import MatchedPair, places, share_explained
from unveil_core.drives.checks.points_seen import seen_share
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera

__all__ = ["CONVENTION_NAMES", "pose_findings"]

RIGHT, WRONG, BETTER = 0.8, 0.5, 0.3
"""Share of the matches that right poses explain at least, and wrong ones at most, and by how much more the former do: right ones
explain 0.8 to 1, the others mostly below 0.3."""
UNSEEN, SEEN = 0.02, 0.3
"""Share of the points that the cameras see, from which on another convention is believed, and below which the given one is not."""
FEWEST_POINTS = 50
FAR, NEAR, NEARER = 0.4, 0.12, 4.0
"""Distance from what photographs show to the nearest point, as a share of its depth: the median beyond which the points are
elsewhere, and below which all is right; between them another reading is right that makes it so many times smaller. Right ones have
0.01 to 0.06; in a narrow street that is turned about its axis something is near everywhere, and 0.2 is usual."""
FEWEST_PLACES = 12
BELOW = 0.6
"""Share of the points near the cameras that lie below these, from which on they are upright: on streets, 0.75 to 1."""
NEAREST = 0.33
"""Share of all points that are near."""
UNITS = {
    0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches", 0.3048: "feet", 1.0: "", 1000.0: "kilometres",
}  # fmt: skip
"""Units that points may be in where poses are in metres, by metres."""
MOST_TRIED = 400
"""Places by which other readings of the points are tried."""
CONVENTION_NAMES = {
    "opengl": "camera to world with OpenGL's axes (x right, y up, z back)",
    "opencv": "camera to world with OpenCV's axes (x right, y down, z forward)",
    "world-to-camera": "world to camera with OpenCV's axes, as extrinsics are",
    "world-to-camera-opengl": "world to camera with OpenGL's axes, as view matrices are",
}


def pose_findings(
    drive: Drive, points: Float64, pairs: Sequence[MatchedPair], *, convention_given: bool = False
) -> list[Finding]:
    """What looks wrong with poses and points.

    Args:
        points: (P, 3) some of the drive's.
        pairs: of photographs that show something both.
        convention_given: the user says what the matrices are.
    """
    cameras = [f.camera for f in drive.frames]
    if (mistake := _other_convention(drive, cameras, points, pairs, convention_given)) is not None:
        return [mistake]
    share = share_explained(pairs, lambda i: cameras[i])
    found = []
    if share is not None and share < WRONG:
        found.append(
            Finding(
                f"photographs disagree with their poses: these explain {share:.0%} of what neighbours show both",
                "check the order of frames and poses, and the lens",
            )
        )
    elsewhere = _elsewhere(cameras, points, pairs)
    return found + ([] if elsewhere is None else [elsewhere])


def _other_convention(
    drive: Drive, cameras: Sequence[Camera], points: Float64, pairs: Sequence[MatchedPair], given: bool
) -> Finding | None:
    """That the matrices are meant otherwise."""
    native = drive.pose_convention
    others = {
        c: in_convention(cameras, native, c)
        for c in POSE_CONVENTIONS
        if c != native and not _upside_down(native, c, points, cameras)
    }
    own = share_explained(pairs, lambda i: cameras[i])
    if own is not None:
        if own >= WRONG:
            return None
        shares = {c: share_explained(pairs, o.__getitem__) or 0.0 for c, o in others.items()}
        best = max(shares, key=lambda c: shares[c])
        if shares[best] < RIGHT or shares[best] < own + BETTER:
            return None
        tells = f"explain {own:.0%} of what neighbouring photographs show both, and {shares[best]:.0%} if they are"
    else:
        seen = seen_share(points, cameras)
        if len(points) < FEWEST_POINTS or seen >= UNSEEN or not _among(cameras, points):
            return None
        shares = {c: seen_share(points, o) for c, o in others.items()}
        best = max(shares, key=lambda c: shares[c])
        if shares[best] < SEEN:
            return None
        tells = f"let the cameras see {seen:.0%} of the points, and {shares[best]:.0%} if they are"
    taken = f"poses, taken as {CONVENTION_NAMES[native]}{', as given' if given else ''}"
    return Finding(f"{taken}, {tells} {CONVENTION_NAMES[best]}", f"add --pose-convention {best}", asks=True)


def _upside_down(native: str, other: str, points: Float64, cameras: Sequence[Camera]) -> bool:
    """Whether another convention turns cameras upside down that stand upright over the points: reversed frames look alike."""
    if {native, other} != {OPENGL, OPENCV} or len(points) < FEWEST_POINTS:
        return False
    some, centres = points[:: -(-len(points) // MOST_TRIED)], np.stack([c.centre for c in cameras])
    away, nearest = cKDTree(centres).query(some)
    near = away <= np.quantile(away, NEAREST)  # of a pitched camera what is far is below, or above, whatever it is
    down = np.stack([c.world_to_camera[1, :3] for c in cameras])[nearest]
    below = ((some - centres[nearest]) * down).sum(axis=1)[near] > 0
    return float(below.mean()) > BELOW


def _elsewhere(cameras: Sequence[Camera], points: Float64, pairs: Sequence[MatchedPair]) -> Finding | None:
    """That the points are not where the cameras are."""
    if len(points) < FEWEST_POINTS:
        return None
    shown = [
        p for pair in pairs if len((p := places(pair, cameras[pair.first], cameras[pair.second]))[0]) >= FEWEST_PLACES
    ]
    if not shown:
        if (seen := seen_share(points, cameras)) >= UNSEEN / 2:
            return None
        away = _distance(cameras, points)
        return Finding(
            f"the cameras see {seen:.1%} of the points, whose middle lies {away} from them",
            "points and poses are of different coordinates: export both together",
            asks=True,
        )
    tree = cKDTree(points)
    apart = min(float(np.median(tree.query(where)[0] / depth)) for where, depth in shown)
    if apart < NEAR:
        return None
    where, depth = (np.concatenate(part) for part in zip(*shown, strict=True))
    step = max(1, -(-len(depth) // MOST_TRIED))
    reading = _other_reading(tree, where[::step], depth[::step], min(NEAR, apart / NEARER))
    if reading is not None:
        problem = f"points lie where the photographs show nothing, and where they show something if {reading}"
        return Finding(problem, "convert the points", asks=True)
    if apart < FAR:
        return None
    away = _distance(cameras, points)
    return Finding(
        f"points lie where the photographs show nothing: their middle is {away} from the cameras",
        "points and poses are of different coordinates: export both together",
        asks=True,
    )


def _among(cameras: Sequence[Camera], points: Float64) -> bool:
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
    best, said = most, None
    for turn, axes in _turns():
        for metres, unit in UNITS.items():
            if unit == "" and axes == "":
                continue
            # Turned points R p * s near a place w are points p near R' w / s.
            apart = tree.query(where @ turn / metres)[0] * metres
            relative = float(np.median(apart / depth))
            if relative < best:
                best = relative
                said = " and ".join(part for part in (f"they are {unit}" if unit else "", axes) if part)
    return said


def _turns() -> Iterator[tuple[Float64, str]]:
    """Rotations that bring axes to axes, and what they mean: the 24 of a cube, the identity first."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                same = np.array_equal(turn, np.eye(3))
                shown = ", ".join(("" if s > 0 else "-") + "xyz"[k] for s, k in zip(signs, order, strict=True))
                yield turn, "" if same else f"their axes are ({shown}) of the poses' (x, y, z)"
