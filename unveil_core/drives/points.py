"""Point clouds as PLY, in double precision."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.ply.reading import UNREADABLE, Vertices, read_vertices
from unveil_core.base.ply.writing import write_vertices
from unveil_core.drives.drive import PointCloud

__all__ = ["read_points", "write_points"]

SCANNED = frozenset(
    (
        "intensity",
        "reflectance",
        "reflectivity",
        "ring",
        "laser_id",
        "laser_number",
        "beam",
        "scan_angle",
        "scan_angle_rank",
        "gps_time",
        "number_of_returns",
        "return_number",
    )
)
"""Properties that only laser scanners write, in lower case; CloudCompare puts ``scalar_`` before them."""


def read_points(path: Path, told: list[str] | None = None) -> PointCloud:
    """Read x y z (any number type) and, where present, red green blue, and what :func:`write_points` writes.

    Args:
        told: gets a line of how many points were left out, whose coordinates are not finite; None = such points are an error.
    Raises:
        DriveError: missing, not a PLY, without x y z, without points that count, or see ``told``.
    """
    if not path.is_file():
        raise DriveError("Not found", path=path, mend="set ply_file_path to a PLY of LiDAR or SfM points")
    try:
        vertices = read_vertices(path, links=True)
        positions = vertices.columns("xyz", np.float64)
        colors = _colors_of(vertices)
        classes = vertices.columns(("train_id",), np.uint8)[:, 0] if "train_id" in vertices.names else None
        moving = vertices.table["moving"] != 0 if "moving" in vertices.names else None
    except UNREADABLE as error:
        problem = f"Not a readable point PLY: {str(error) or type(error).__name__}"
        raise DriveError(problem, path=path, mend="export it again") from error
    if not len(positions):
        raise DriveError("holds no points", path=path, mend="a drive needs LiDAR or SfM points")
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    lost = int(len(finite) - finite.sum())
    if lost and (told is None or lost == len(finite)):
        problem = f"{lost} of {len(finite)} points are not finite, the first of them {int(np.argmin(finite))}"
        raise DriveError(problem, path=path, mend="export it again without NaN and infinity")
    bare = {n.lower().removeprefix("scalar_") for n in vertices.names}
    cloud = PointCloud(positions, colors, bool(bare & SCANNED), classes, moving)
    if lost and told is not None:
        told.append(f"{path.name}: {lost} of {len(finite)} points are NaN or infinite and are left out")
        cloud = cloud.select(finite)
    return cloud


def _colors_of(vertices: Vertices) -> NDArray[np.uint8] | None:
    """(P, 3), None where there are none: of bytes, of 16 bits, or of floating point from 0 to 1."""
    names = ("red", "green", "blue")
    if not set(names) <= set(vertices.names):
        return None
    kind = np.result_type(*(vertices.table.dtype[n] for n in names)).newbyteorder("=")
    found: NDArray[Any] = vertices.columns(names, kind.type)
    if found.dtype == np.uint8:
        return found
    if found.dtype.kind == "f":
        found = np.nan_to_num(found, posinf=255, neginf=0)
        found = (found * 255).round() if found.max(initial=0) <= 1 else found
    elif found.dtype.itemsize > 1 and found.max(initial=0) > 255:
        found = found.astype(np.float64) / 257  # of 16 bits: 65535 is white
        found = found.round()
    return np.clip(found, 0, 255).astype(np.uint8)


def write_points(points: PointCloud, path: Path) -> None:
    """Write doubles and, where there are, colours, classes (``train_id``) and ``moving``; atomically."""
    kind = [(n, "<f8") for n in "xyz"]
    if points.colors is not None:
        kind += [(n, "u1") for n in ("red", "green", "blue")]
    more = {n: v for n, v in (("train_id", points.classes), ("moving", points.moving)) if v is not None}
    kind += [(n, "u1") for n in more]
    table = np.empty(len(points.positions), dtype=kind)
    for i, name in enumerate("xyz"):
        table[name] = points.positions[:, i]
    if points.colors is not None:
        for i, name in enumerate(("red", "green", "blue")):
            table[name] = points.colors[:, i]
    for name, values in more.items():
        table[name] = values
    write_vertices(path, table)
