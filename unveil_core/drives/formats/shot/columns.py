"""Camera paths as columns of text: Nuke's ``.chan``, which 3DEqualizer and others write, and SynthEyes' plain *Camera Path*.

A line a frame: number, three coordinates, three angles in degrees, and mostly a field of view. The camera looks along -z with y
up. Nuke has y up in the world, turns in the order ZXY, about z first, and its field of view is vertical; SynthEyes lets its user
choose each of these. What the file cannot tell stands in ``shot.json``.

Sources: Foundry's manual (*Import chan file*), Blender's manual (*Nuke Animation*), Boris FX' manual of SynthEyes (*Transferring
3-D Paths*).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.base.types import Float64
from unveil_core.drives.checks.conventions import OPENGL
from unveil_core.drives.formats.shot.described import Described
from unveil_core.drives.formats.shot.path import CameraPath, Lens, LensOf, PathFrame
from unveil_core.drives.scale_and_up import UP_AXES

__all__ = ["read_columns", "turned"]

COLUMNS = "frame tx ty tz rx ry rz fov"
UP = "y"
"""Of Nuke's worlds, and of 3DEqualizer's."""


def read_columns(path: Path, said: Described) -> CameraPath:
    """Read a camera path of columns.

    Raises:
        DriveError: a line that is none, a frame that is there twice, or nothing that tells the focal length.
    """
    rows = _rows(path)
    frames, seen = [], set()
    for number, values in rows:
        if number in seen:
            raise DriveError(f"has frame {number} twice", path=path, mend="export one camera, each frame once")
        seen.add(number)
        pose = np.eye(4)
        pose[:3, :3] = turned(values[3:6], said.rotation_order)
        pose[:3, 3] = values[:3]
        zoom = float(values[6]) if len(values) > 6 else None
        frames.append(PathFrame(pose, _lens(zoom, said, path), number=number, camera=said.camera))
    return CameraPath(tuple(frames), OPENGL, None, UP_AXES[UP])


def turned(degrees: Float64, order: str) -> Float64:
    """(3, 3) rotation of angles about x, y and z, degrees; ``order`` names the axes, that which is turned about first first."""
    found = np.eye(3)
    for name in order:
        axis = "XYZ".index(name)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        sin, cos = math.sin(math.radians(degrees[axis])), math.cos(math.radians(degrees[axis]))
        step = np.eye(3)
        step[a, a] = step[b, b] = cos
        step[a, b], step[b, a] = -sin, sin
        found = step @ found
    return found


def _rows(path: Path) -> list[tuple[int, Float64]]:
    found: list[tuple[int, Float64]] = []
    for k, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or words[0].startswith(("#", "//")):
            continue
        try:
            values = np.array([float(w) for w in words])
        except ValueError:
            values = np.zeros(0)
        whole = len(values) in (7, 8) and np.isfinite(values).all() and values[0] == round(values[0])
        if not whole:
            problem = f"Not a frame of a camera path: line {k}: {line.strip()[:60]!r}"
            raise DriveError(problem, path=path, mend=f"a line has {COLUMNS}, and the last may be missing")
        found.append((int(values[0]), values[1:]))
    if not found:
        raise DriveError("holds no frames", path=path, mend="export the camera again, over the shot's frames")
    return found


def _lens(zoom: float | None, said: Described, path: Path) -> LensOf:
    """Of a frame, by its last column or by what is said."""
    kind = "none" if zoom is None else said.zoom
    where = said.source or path
    if kind in ("vertical_fov", "horizontal_fov") and not 0 < (zoom or 0.0) < 180:
        raise DriveError(
            f"has a field of view of {zoom:g} degrees",
            path=path,
            mend=f'if its last column is something else, set "zoom" in shot.json: {", ".join(("focal_mm", "none"))}',
        )
    millimetres = said.focal_mm if kind == "none" else zoom
    if kind in ("focal_mm", "none") and (millimetres is None or said.sensor_mm is None):
        lacks = "its focal length" if millimetres is None else "the width of the sensor"
        raise DriveError(
            f"does not tell {lacks}", path=where, mend='set "focal_mm" and "sensor_mm" in shot.json beside it'
        )

    def lens(size: tuple[int, int], pixel_aspect: float) -> Lens:
        width, height = size
        aspect = said.pixel_aspect or pixel_aspect
        if kind == "vertical_fov":
            fy = height / (2 * math.tan(math.radians(zoom or 0.0) / 2))
            fx = fy / aspect
        elif kind == "horizontal_fov":
            fx = width / (2 * math.tan(math.radians(zoom or 0.0) / 2))
            fy = fx * aspect
        else:
            assert said.sensor_mm is not None and millimetres is not None
            fx = millimetres * width / said.sensor_mm[0]
            fy = fx * aspect if said.sensor_mm[1] is None else millimetres * height / said.sensor_mm[1]
        return Lens(size, (fx, fy), (width / 2, height / 2), said.distortion)

    return lens
