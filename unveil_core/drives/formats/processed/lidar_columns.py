"""LiDAR files of bare float32 whose number of columns nothing tells but their numbers.

14  origin xyz, point xyz, flow xyz and class, ground, intensity, elongation, laser    Waymo of DriveStudio and EmerNeRF
10  origin xyz, point xyz, ground, intensity, elongation, laser                        Waymo of S3Gaussian
 6  point xyz, intensity, ring, laser                                                  nuPlan
 5  point xyz, intensity, laser                                                        PandaSet
 4  point xyz, intensity                                                               Argoverse 2, nuScenes, KITTI
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.drive import SweepPoints
from unveil_core.drives.formats.binary import read_floats

__all__ = ["OF_WAYMO", "WITHOUT_ORIGIN", "columns_of", "read_sweep"]

FARTHEST_M = 1000.0
"""Of a LiDAR point, and of what may pass for one; the lasers see to 300 m."""
WIDEST_VEHICLE_M = 10.0
"""From the vehicle's origin to a laser on it."""
MOST_LASERS, MOST_RINGS = 5, 255
"""Largest number of one of Waymo's five lasers, counted from 0 or 1, and of a ring or laser elsewhere."""
OF_WAYMO = (14, 10)
WITHOUT_ORIGIN = (6, 5, 4)
"""In the order of trial: a wide layout has more columns that must be numbers of lasers, so it passes less easily."""


def columns_of(values: NDArray[np.float32], widths: Sequence[int]) -> int | None:
    """Number of columns of a file's numbers (N,), out of those that it may have; None where none fits."""
    return next((w for w in widths if len(values) % w == 0 and _fits(values.reshape(-1, w))), None)


def read_sweep(path: Path, world_from_points: Float64, widths: Sequence[int]) -> SweepPoints:
    """The points of a file.

    Args:
        path: of the file; world_from_points: (4, 4) from their axes to the drive's coordinates.
        widths: numbers of columns that it may have.
    Raises:
        DriveError: missing, or of no known layout.
    """
    values = read_floats(path, None)
    columns = columns_of(values, widths)
    if columns is None:
        tried = " nor ".join(str(w) for w in widths)
        problem = f"Cut short, or of unknown columns: neither {tried} make points and lasers"
        raise DriveError(problem, path=path, mend="prepare the scene again")
    first = 3 if columns in OF_WAYMO else 0
    points = values.reshape(-1, columns)[:, first : first + 3].astype(np.float64)
    return SweepPoints(points @ world_from_points[:3, :3].T + world_from_points[:3, 3])


def _fits(rows: NDArray[np.float32]) -> bool:
    width = rows.shape[1]
    if width in OF_WAYMO:
        lasers = _are_numbers(rows[:, -1], MOST_LASERS)
        return lasers and _are_points(rows[:, 3:6]) and bool((np.abs(rows[:, :3]) < WIDEST_VEHICLE_M).all())
    # A coordinate that slips into the place of the intensity is soon negative.
    if not _are_points(rows[:, :3]) or bool((rows[:, 3] < 0).any()):
        return False
    return all(_are_numbers(rows[:, column], MOST_RINGS) for column in range(4, width))


def _are_points(xyz: NDArray[np.float32]) -> bool:
    return bool((np.abs(xyz) < FARTHEST_M).all())


def _are_numbers(column: NDArray[np.float32], most: int) -> bool:
    return bool(((column >= 0) & (column <= most) & (column == np.round(column))).all())
