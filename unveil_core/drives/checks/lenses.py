"""Whether lenses can be those of the pictures: where the principal point lies, how much they see, and whether what photographs show
lies at the points only with another focal length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from scipy.spatial import cKDTree

from unveil_core.drives.checks.agreement import Agreement, agreement
from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.checks.matches import MatchedPair
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import FISHEYE

__all__ = ["lens_findings", "other_focal_length"]

OFF_MIDDLE = 0.2
"""Share of the picture's side that a principal point may lie off its middle. Lenses are centred to a few hundredths; what is
cropped on one side, or calibrated at another size, lies far off."""
CENTRED = 0.1
"""By so much of half a side a lens may be off the middle."""
WIDEST_DEG, NARROWEST_DEG = 150.0, 3.0
"""Horizontal fields of view of pinhole lenses: beyond, the focal length is in another unit, or of another size."""
DOUBTED, TIMES = 0.06, 3.0
"""Distance from what photographs show to the nearest point, as a share of its depth, beyond which other focal lengths are tried;
and how many times smaller it is with the right one. Of drives that are right it is 0.01 to 0.05, and none other betters it."""
FACTORS = tuple(2 ** (k / 4) for k in range(-8, 9) if abs(k) > 1)
"""Of focal lengths that are tried."""


def lens_findings(drive: Drive) -> list[Finding]:
    """What looks wrong with the lenses, once for each camera and lens; it asks where nothing can see like that."""
    found: list[Finding] = []
    seen = set()
    for frame in drive.frames:
        camera = frame.camera
        key = (frame.camera_name, camera.intrinsics)
        if key in seen:
            continue
        seen.add(key)
        if frame.distortion is None or frame.distortion.model != FISHEYE:
            view = math.degrees(2 * math.atan(camera.width / (2 * camera.fx)))
            if not NARROWEST_DEG < view < WIDEST_DEG:
                found.append(
                    Finding(
                        f"camera {frame.camera_name} sees {view:.3g} degrees: its focal length is {camera.fx:.4g} pixels, its "
                        f"pictures are {camera.width} wide",
                        "give it in pixels of these pictures, not in millimetres, as a share of their size or of another size",
                        asks=True,
                    )
                )
                continue
        right, down = camera.cx / camera.width, camera.cy / camera.height
        if max(abs(right - 0.5), abs(down - 0.5)) > OFF_MIDDLE:
            found.append(
                Finding(
                    f"the principal point of camera {frame.camera_name} lies at {right:.2f} of its pictures' width and "
                    f"{down:.2f} of their height",
                    _mend(camera),
                )
            )
    return found


def _mend(camera: Camera) -> str:
    """What brings a principal point to the middle of the pictures, where something usual does."""
    right, down = 2 * camera.cx / camera.width, 2 * camera.cy / camera.height
    if max(abs(2 * camera.cy / camera.width - 1), abs(2 * camera.cx / camera.height - 1)) < CENTRED:
        return "cx and cy are exchanged: put them right"
    if min(right, down) > CENTRED and abs(right / down - 1) < CENTRED:
        return f"the calibration is of pictures {right:.3g} times as large: multiply focal lengths, cx and cy by {1 / right:.3g}"
    return "pictures were reduced or cropped after the calibration: correct it, or take the pictures that it is of"


def other_focal_length(
    drive: Drive, pairs: Sequence[MatchedPair], own: Agreement, tree: cKDTree | None
) -> Finding | None:
    """That another focal length would bring what photographs show to the points.

    Args:
        pairs: of photographs that show something both; own: of the drive as it was read; tree: of its points.
    """
    if own.apart is None or own.apart < DOUBTED:
        return None
    tried = {}
    for factor in FACTORS:
        shown = [replace(p, rays=tuple(r / (factor, factor, 1.0) for r in p.rays)) for p in pairs]  # type: ignore[arg-type]
        tried[factor] = agreement(shown, lambda i: drive.frames[i].camera, tree)
    best = min(tried, key=lambda f: tried[f].apart or math.inf)
    if not tried[best].puts_right(own, near=DOUBTED, times=TIMES):
        return None
    camera = drive.frames[pairs[0].first].camera
    return Finding(
        f"points lie beside what the photographs show, and where they show it with a focal length of about {best * camera.fx:.0f} "
        f"pixels; that of camera {drive.frames[pairs[0].first].camera_name} is {camera.fx:.0f}",
        "correct it: it may belong to another size of the pictures, or be half an angle of view",
    )
