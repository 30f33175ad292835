"""Lenses of transforms.json: focal length, principal point and distortion, per file or per frame.

nerfstudio counts OPENCV's k1 to k4 as one polynomial in r² and OpenCV its k4 to k6 as a denominator. A k4 alone is nerfstudio's,
which OpenCV cannot undistort; with k5 or k6 it is OpenCV's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.checks.sizes import calibration_size
from unveil_core.drives.drive import Distortion
from unveil_core.drives.formats.cameras import picture_size
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.geometry.camera import Camera

__all__ = ["crop_notice", "degrees_notice", "read_lens"]

FISHEYE = "OPENCV_FISHEYE"
MODELS = {
    "PINHOLE": None,
    "SIMPLE_PINHOLE": None,
    "PERSPECTIVE": "OPENCV",
    "OPENCV": "OPENCV",
    "FULL_OPENCV": "OPENCV",
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "OPENCV_FISHEYE": FISHEYE,
    "FISHEYE": FISHEYE,
}
"""Models of cameras, and OpenCV's distortion that they have."""
NO_PINHOLE = (
    "EQUIRECTANGULAR",
    "OMNIDIRECTIONALSTEREO_L",
    "OMNIDIRECTIONALSTEREO_R",
    "VR180_L",
    "VR180_R",
    "ORTHOPHOTO",
    "FISHEYE624",
)
"""Models of nerfstudio that no pinhole picture of the same size can be made of."""
LEAST_DEGREES, MOST_DEGREES = 10.0, 180.0
"""Of a field of view that is meant in degrees: below, numbers beyond a half turn of radians are a mistake of another kind."""
MOST_PIXELS = 1 << 20
"""Of a side of a picture."""


def read_lens(keys: Keys, image: Path, pose: Float64) -> tuple[Camera, Distortion | None]:
    """The camera of a frame and its distortion.

    Args:
        keys: of the frame; image: its photograph; pose: (4, 4) world to camera with OpenCV axes.
    Raises:
        DriveError: numbers that make no camera, or a model that is not read.
    """
    (width, height), told = _size(keys, image)
    cx, cy = keys.number("cx"), keys.number("cy")
    if not told and cx is not None and cy is not None:
        width, height = calibration_size((width, height), (cx, cy))
    focal_x, focal_y = keys.number("fl_x"), keys.number("fl_y")
    angle_x, angle_y = keys.number("camera_angle_x"), keys.number("camera_angle_y")
    fx = _focal(width, angle_x) if focal_x is None else focal_x
    if fx is None and angle_x is not None:
        problem = f"Not a field of view: camera_angle_x is {angle_x:g}"
        raise DriveError(problem, path=keys.path, mend="give radians, above 0 and below 3.14, or fl_x in pixels")
    if fx is None:
        raise DriveError(
            "has neither fl_x nor camera_angle_x", path=image, mend="add the focal length to transforms.json"
        )
    fy = (_focal(height, angle_y) if focal_x is None else None) if focal_y is None else focal_y
    fy = fx if fy is None else fy
    cx, cy = width / 2 if cx is None else cx, height / 2 if cy is None else cy
    if not all(math.isfinite(v) for v in (fx, fy)) or fx <= 0 or fy <= 0 or width < 1 or height < 1:
        raise DriveError("has camera numbers that make no camera", path=image, mend="check w, h, fl_x, fl_y, cx, cy")
    return Camera(width, height, fx, fy, cx, cy, pose), _distortion(keys, image)


def degrees_notice(values: Sequence[object]) -> str | None:
    """A line where fields of view, as a file has them, are taken for degrees; None where none is."""
    odd = next((v for v in values if isinstance(v, int | float) and LEAST_DEGREES <= v < MOST_DEGREES), None)
    return (
        None
        if odd is None
        else f"camera_angle_x or camera_angle_y is {odd:g}: taken for degrees, {math.radians(odd):.4g} radians"
    )


def _focal(side: int, angle: float | None) -> float | None:
    """Pixels, of a field of view in radians; what is too much for these is taken for degrees."""
    if angle is not None and LEAST_DEGREES <= angle < MOST_DEGREES:
        angle = math.radians(angle)
    if angle is None or not 0 < angle < math.pi:
        return None
    half = math.tan(angle / 2)
    return side / (2 * half) if half > 0 else None  # of an angle that is all but 0, nothing is left


def _size(keys: Keys, image: Path) -> tuple[tuple[int, int], bool]:
    """Width and height, and whether the file says them; else they are the picture's, from its header."""
    width, height = keys.number("w"), keys.number("h")
    if width is not None and height is not None:
        if not (1 <= width <= MOST_PIXELS and 1 <= height <= MOST_PIXELS):
            raise DriveError(f"w and h are {width:g} and {height:g}", path=keys.path, mend="correct them")
        return (int(width), int(height)), True
    return picture_size(image), False


def _distortion(keys: Keys, image: Path) -> Distortion | None:
    usual = FISHEYE if keys.get("is_fisheye") is True else "OPENCV"
    model = str(keys.get("camera_model") or usual).upper()
    if model in NO_PINHOLE:
        raise DriveError(
            f"camera_model {model} cannot be undistorted to a pinhole picture", path=image, mend="cut perspective views"
        )
    if model not in MODELS:
        raise DriveError(f"Not a known camera_model: {model}", path=image, mend=f"use one of {', '.join(MODELS)}")
    kind = MODELS[model]
    if kind is None:
        return None
    k = {n: keys.number(n) or 0.0 for n in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")}
    if kind == FISHEYE:
        return Distortion(FISHEYE, (k["k1"], k["k2"], k["k3"], k["k4"]))
    if k["k4"] and not k["k5"] and not k["k6"] and model != "FULL_OPENCV":
        raise DriveError(
            "has a k4 without k5 and k6: nerfstudio's fourth radial term, which OpenCV lacks",
            path=image,
            mend="calibrate with k1 to k3, or name camera_model FULL_OPENCV if it is OpenCV's k4",
        )
    order = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    distortion = Distortion("OPENCV", tuple(k[n] for n in order))
    return None if distortion.is_zero else distortion


def crop_notice(radius: float | None, cameras: list[tuple[Camera, Distortion | None]]) -> str | None:
    """A line where the circle of a fisheye's picture (nerfstudio's ``fisheye_crop_radius``, pixels) ends within the pinhole
    picture that is made of it, None where it does not matter."""
    if radius is None:
        return None
    for camera, distortion in cameras:
        if distortion is None or distortion.model != FISHEYE:
            continue
        far = math.hypot(max(camera.cx, camera.width - camera.cx), max(camera.cy, camera.height - camera.cy))
        seen = camera.fx * math.atan2(far, camera.fx)
        if seen > radius:
            return (
                f"fisheye_crop_radius {radius:g}: undistorted corners show what lies up to {seen:.0f} pixels from the middle; "
                "if that is black, give masks or a smaller w and h"
            )
    return None
