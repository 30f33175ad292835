"""A look over a drive before work starts: what seems to be wrong with it, the worst first."""

from __future__ import annotations

from dataclasses import replace

from unveil_core.base.types import Float64
from unveil_core.drives.checks.agreement import agreement, tree_of
from unveil_core.drives.checks.elsewhere import DOUBTED, points_elsewhere, points_read_otherwise
from unveil_core.drives.checks.findings import Finding, worst_first
from unveil_core.drives.checks.lenses import lens_findings, other_focal_length
from unveil_core.drives.checks.matches import matched_pairs
from unveil_core.drives.checks.points_seen import some_points
from unveil_core.drives.checks.poses import WRONG, other_convention, poses_disagree
from unveil_core.drives.checks.way import way_findings
from unveil_core.drives.drive import Drive
from unveil_core.drives.scale_and_up import Placement

__all__ = ["looked_over"]


def looked_over(drive: Drive, placement: Placement, *, convention_given: bool = False) -> tuple[Finding, ...]:
    """What looks wrong with a drive as read: its poses, points and lenses. It takes a second: some photographs are compared, and of
    a drive with sweeps a few are read.

    Args:
        drive: with frames; placement: its scale and up.
        convention_given: the user says what the matrices of poses are.
    """
    points = some_points(drive)
    found = _seen(drive, points, convention_given)
    # Of cameras that look elsewhere neither heights nor neighbours tell anything more.
    rest = [] if any(f.asks for f in found) else way_findings(drive, points, placement)
    return worst_first([*found, *rest])


def _seen(drive: Drive, points: Float64, convention_given: bool) -> list[Finding]:
    """What lenses, photographs, poses and points say of one another, the first mistake alone: the others follow from it."""
    lenses = lens_findings(drive)
    if any(f.asks for f in lenses):
        return lenses  # rays that nothing can have tell nothing of poses
    pairs, tree = matched_pairs(drive), tree_of(points)
    cameras = [f.camera for f in drive.frames]
    own = agreement(pairs, cameras.__getitem__, tree)
    turned = other_convention(drive, points, pairs, own, tree, given=convention_given)
    if turned is not None:
        return [turned, *lenses]
    off = (own.share is not None and own.share < WRONG) or (own.apart is not None and own.apart >= DOUBTED)
    if lenses and off:
        return [replace(f, asks=True) for f in lenses]
    points_off = points_read_otherwise(own, tree)
    if points_off is None:
        elsewhere, focal = points_elsewhere(cameras, points, own), other_focal_length(drive, pairs, own, tree)
        points_off = elsewhere if focal is None else replace(focal, asks=elsewhere is not None)
    return [f for f in (poses_disagree(own), points_off) if f is not None] + lenses
