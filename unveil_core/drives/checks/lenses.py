"""Whether lenses can be those of the pictures: where the principal point lies, and how much they see."""

from __future__ import annotations

import math

from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.drive import Drive
from unveil_core.geometry.lens import FISHEYE

__all__ = ["lens_findings"]

OFF_MIDDLE = 0.2
"""Share of the picture's side that a principal point may lie off its middle. Lenses are centred to a few hundredths; what is
cropped on one side, or calibrated at another size, lies far off."""
WIDEST_DEG, NARROWEST_DEG = 150.0, 3.0
"""Horizontal fields of view of pinhole lenses: beyond, the focal length is in another unit, or of another size."""


def lens_findings(drive: Drive) -> list[Finding]:
    """What looks wrong with the lenses, once for each camera and lens."""
    found: list[Finding] = []
    seen = set()
    for frame in drive.frames:
        camera = frame.camera
        key = (frame.camera_name, camera.intrinsics)
        if key in seen:
            continue
        seen.add(key)
        right, down = camera.cx / camera.width, camera.cy / camera.height
        if max(abs(right - 0.5), abs(down - 0.5)) > OFF_MIDDLE:
            found.append(
                Finding(
                    f"the principal point of camera {frame.camera_name} lies at {right:.2f} of its pictures' width and "
                    f"{down:.2f} of their height",
                    "pictures were reduced or cropped after the calibration: correct it, or take the pictures that it is of",
                )
            )
        if frame.distortion is not None and frame.distortion.model == FISHEYE:
            continue
        view = math.degrees(2 * math.atan(camera.width / (2 * camera.fx)))
        if not NARROWEST_DEG < view < WIDEST_DEG:
            found.append(
                Finding(
                    f"camera {frame.camera_name} sees {view:.3g} degrees: its focal length is {camera.fx:.4g} pixels, its pictures "
                    f"are {camera.width} wide",
                    "give it in pixels of these pictures, not in millimetres or of another size",
                )
            )
    return found
