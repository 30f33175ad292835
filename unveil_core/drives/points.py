"""Point clouds as PLY, in double precision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyParseError

from unveil_core.base.errors import DriveError
from unveil_core.base.files import write_atomic
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


def read_points(path: Path) -> PointCloud:
    """Read x y z (any number type) and, where present, red green blue, and what :func:`write_points` writes.

    Raises:
        DriveError: missing, not a PLY, without x y z, without points, or with coordinates that are not finite.
    """
    if not path.is_file():
        raise DriveError(
            "there is no such point file", path=path, mend="set ply_file_path to a PLY of LiDAR or SfM points"
        )
    try:
        vertex = PlyData.read(str(path))["vertex"].data
        positions = np.stack([np.asarray(vertex[n], dtype=np.float64) for n in "xyz"], axis=1)
    except (PlyParseError, KeyError, ValueError, EOFError, OSError) as error:
        raise DriveError(f"is not a readable point PLY: {error}", path=path) from error
    if not len(positions):
        raise DriveError("holds no points", path=path, mend="a drive needs LiDAR or SfM points")
    finite = np.isfinite(positions).all(axis=1)
    if not finite.all():
        raise DriveError(f"point {int(np.argmin(finite))} is not finite", path=path)
    names = vertex.dtype.names or ()
    colors = None
    if {"red", "green", "blue"} <= set(names):
        colors = np.stack([np.asarray(vertex[n]) for n in ("red", "green", "blue")], axis=1)
        colors = (colors * 255).round() if colors.dtype.kind == "f" and colors.max() <= 1 else colors
        colors = colors.astype(np.uint8)
    bare = {n.lower().removeprefix("scalar_") for n in names}
    classes = np.asarray(vertex["train_id"], dtype=np.uint8) if "train_id" in names else None
    moving = np.asarray(vertex["moving"]) != 0 if "moving" in names else None
    return PointCloud(positions, colors, bool(bare & SCANNED), classes, moving)


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
    data = PlyData([PlyElement.describe(table, "vertex")], text=False, byte_order="<")
    write_atomic(path, data.write)
