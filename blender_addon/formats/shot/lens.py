# SPDX-License-Identifier: GPL-3.0-or-later
"""Lens distortion of Blender's movie clips as OpenCV's numbers. No bpy here.

Blender's tracker, libmv, bends normalized coordinates with y up, and OpenCV with y down: radial terms are the same, and the
tangential ones, which libmv also counts the other way round, change places, one of them its sign.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["PLAIN", "ClipLensError", "opencv_of_clip"]

PLAIN = (0.0,) * 8
"""No distortion: k1 k2 p1 p2 k3 k4 k5 k6."""
UNDISTORT = "undistort the plates (Movie Clip Editor, or Nuke), give those, and set the clip's distortion to 0"


class ClipLensError(ValueError):
    """A distortion that OpenCV's model does not have, in one line."""


def opencv_of_clip(model: str, k: Mapping[str, float], ratio: float = 1.0) -> tuple[float, ...]:
    """k1 k2 p1 p2 k3 k4 k5 k6 of OpenCV.

    Args:
        model: ``tracking.camera.distortion_model``.
        k: its numbers by their names there, as ``k1``, ``brown_p1``, ``division_k1``.
        ratio: focal length of the camera that is used over the clip's own: the same bend in other units.
    Raises:
        ClipLensError: the model is none that OpenCV has.
    """
    if model == "POLYNOMIAL":
        radial, tangential = [k["k1"], k["k2"], k["k3"]], [0.0, 0.0]
    elif model == "BROWN":
        if k["brown_k4"]:
            raise ClipLensError(f"The clip's lens has a k4 of Brown, which is not read: set it to 0, or {UNDISTORT}")
        radial = [k["brown_k1"], k["brown_k2"], k["brown_k3"]]
        tangential = [-k["brown_p2"], k["brown_p1"]]
    else:
        numbers = [v for name, v in k.items() if name.startswith(f"{model.lower()}_")]
        if not any(numbers):
            return PLAIN
        raise ClipLensError(f"The clip's lens has the model {model.capitalize()}, which is not read: {UNDISTORT}")
    r1, r2, r3 = (v * ratio ** (2 * i + 2) for i, v in enumerate(radial))
    p1, p2 = (v * ratio for v in tangential)
    return (r1, r2, p1, p2, r3, 0.0, 0.0, 0.0)
