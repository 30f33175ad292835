"""Whether poses and photographs can be of one place; and the usual mistakes where they cannot.

Matrices are meant otherwise than the format says, or are of other photographs. These tell it best (``matches``): what two of them
show both must lie before both, and where it lies there must be points. Where they show too little in common, how many points the
cameras see must do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.drive_options import POSE_CONVENTIONS
from unveil_core.base.types import Float64
from unveil_core.drives.checks.agreement import FEWEST_POINTS, RIGHT, Agreement, agreement
from unveil_core.drives.checks.conventions import OPENCV, OPENGL, in_convention
from unveil_core.drives.checks.elsewhere import UNSEEN, among
from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.checks.matches import MatchedPair
from unveil_core.drives.checks.points_seen import seen_share
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera

__all__ = ["CONVENTION_NAMES", "WRONG", "other_convention", "poses_disagree"]

WRONG, BETTER = 0.5, 0.3
"""Share of the matches that wrong poses explain at most, where no points tell, and by how much more others must."""
SEEN = 0.3
"""Share of the points that the cameras see, from which on another convention is believed, where the photographs tell nothing."""
BELOW = 0.6
"""Share of the points near the cameras that lie below these, from which on they are upright: on streets, 0.75 to 1."""
NEAREST = 0.33
"""Share of all points that are near."""
MOST_TRIED = 400
CONVENTION_NAMES = {
    "opengl": "camera to world with OpenGL's axes (x right, y up, z back)",
    "opencv": "camera to world with OpenCV's axes (x right, y down, z forward)",
    "world-to-camera": "world to camera with OpenCV's axes, as extrinsics are",
    "world-to-camera-opengl": "world to camera with OpenGL's axes, as view matrices are",
}


def poses_disagree(own: Agreement) -> Finding | None:
    """That photographs show another motion than the poses of the drive as it was read."""
    if own.share is None or own.share >= WRONG:
        return None
    return Finding(
        f"photographs disagree with their poses: these explain {own.share:.0%} of what neighbours show both",
        "check the order of frames and poses, and the lens",
    )


def other_convention(
    drive: Drive,
    points: Float64,
    pairs: Sequence[MatchedPair],
    own: Agreement,
    tree: cKDTree | None,
    *,
    given: bool = False,
) -> Finding | None:
    """That the matrices of poses are meant otherwise.

    Args:
        points: (P, 3) some of the drive's; tree: of them.
        pairs: of photographs that show something both; own: of the drive as it was read.
        given: the user says what the matrices are.
    """
    cameras = [f.camera for f in drive.frames]
    native = drive.pose_convention
    others = {
        c: in_convention(cameras, native, c)
        for c in POSE_CONVENTIONS
        if c != native and not _upside_down(native, c, points, cameras)
    }
    if own.share is not None:
        found = {c: agreement(pairs, o.__getitem__, tree) for c, o in others.items()}
        best = max(found, key=lambda c: found[c].share or 0.0)
        share = found[best].share or 0.0
        clearly = own.share < WRONG and share >= max(RIGHT, own.share + BETTER)
        if not clearly and not (share > own.share and found[best].puts_right(own)):
            return None
        tells = f"explain {own.share:.0%} of what neighbouring photographs show both, and {share:.0%} if they are"
    else:
        seen = seen_share(points, cameras)
        if len(points) < FEWEST_POINTS or seen >= UNSEEN or not among(cameras, points):
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
