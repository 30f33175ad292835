"""A look over a drive before work starts: what seems to be wrong with it, the worst first."""

from __future__ import annotations

from unveil_core.drives.checks.findings import Finding, worst_first
from unveil_core.drives.checks.lenses import lens_findings
from unveil_core.drives.checks.matches import matched_pairs
from unveil_core.drives.checks.points_seen import some_points
from unveil_core.drives.checks.poses import pose_findings
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
    found = pose_findings(drive, points, matched_pairs(drive), convention_given=convention_given)
    # Of cameras that look elsewhere neither heights nor neighbours tell anything more.
    rest = [] if any(f.asks for f in found) else way_findings(drive, points, placement)
    return worst_first([*found, *lens_findings(drive), *rest])
