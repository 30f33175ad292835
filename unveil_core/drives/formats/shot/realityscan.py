"""RealityScan's and RealityCapture's *Internal/External camera parameters* (CSV): a line a picture, by its name.

``heading``, ``pitch`` and ``roll`` are degrees; at 0 the camera looks straight down with the top of the picture to the north, along
y. Lengths of the lens are millimetres of a film of 36 mm along the longer side; the principal point counts from the middle.
Source: nerfstudio-project/nerfstudio (``process_data/realitycapture_utils.py``), Epic's reference of camera geometry.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.drives.checks.conventions import OPENGL
from unveil_core.drives.drive import Distortion
from unveil_core.drives.formats.shot.columns import turned
from unveil_core.drives.formats.shot.path import CameraPath, Lens, LensOf, PathFrame

__all__ = ["read_realityscan"]

NEEDED = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
LENS = ("px", "py", "k1", "k2", "k3", "k4", "t1", "t2")
FILM_MM = 36.0
MEND = "export it again by Alignment > Registration > Internal/External camera parameters"


def read_realityscan(path: Path) -> CameraPath:
    """Read a CSV file of cameras.

    Raises:
        DriveError: it is another CSV, or a lens has what OpenCV's lacks.
    """
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    names = [n.strip().lower() for n in lines[0].lstrip("#").split(",")] if lines else []
    lacking = [n for n in NEEDED if n not in names]
    if lacking:
        raise DriveError(f"has no column {lacking[0]}, as RealityScan's cameras have", path=path, mend=MEND)
    frames = []
    for k, row in enumerate(csv.reader(lines[1:]), start=2):
        held = dict(zip(names, row, strict=False))
        try:
            numbers = {n: float(held.get(n) or 0.0) for n in (*NEEDED[1:], *LENS)}
        except ValueError as error:
            raise DriveError(f"Not a number in line {k}: {error}", path=path, mend=MEND) from error
        if len(row) < len(NEEDED) or not np.isfinite(list(numbers.values())).all() or numbers["f"] <= 0:
            raise DriveError(f"Not a camera: line {k}", path=path, mend=MEND)
        if numbers["k4"]:
            raise DriveError(
                f"line {k} has a k4, which OpenCV's lens lacks",
                path=path,
                mend="choose the distortion model Brown3, or export undistorted pictures",
            )
        pose = np.eye(4)
        angles = np.array([numbers["pitch"], numbers["roll"], -numbers["heading"]])
        pose[:3, :3] = turned(angles, "YXZ")
        pose[:3, 3] = numbers["x"], numbers["y"], numbers["alt"]
        frames.append(PathFrame(pose, _lens(numbers), name=held["name"].strip()))
    if not frames:
        raise DriveError("holds no cameras", path=path, mend=MEND)
    return CameraPath(tuple(frames), OPENGL, None, np.array([0.0, 0.0, 1.0]))


def _lens(n: dict[str, float]) -> LensOf:
    def lens(size: tuple[int, int], _: float) -> Lens:
        pixels = max(size) / FILM_MM
        bent = Distortion("OPENCV", (n["k1"], n["k2"], n["t1"], n["t2"], n["k3"], 0.0, 0.0, 0.0))
        centre = size[0] / 2 + n["px"] * pixels, size[1] / 2 + n["py"] * pixels
        return Lens(size, (n["f"] * pixels, n["f"] * pixels), centre, None if bent.is_zero else bent)

    return lens
