"""Tracks of GPS receivers: GPX files, and the places that photographs note."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from unveil_core.base.disk.open_safely import check_file
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.formats.kitti.boxes import xml_items

__all__ = ["level_metres", "read_gpx"]

EARTH_M = 6_378_137.0
LARGEST_GPX = 1 << 26
"""Bytes: a week at a point a second."""
POINTS_AT = 3
"""How deep points lie: in a segment of a track of the file."""


def read_gpx(path: Path) -> tuple[Float64, Float64]:
    """(T,) seconds since 1970, rising, and (T, 2) latitude and longitude in degrees, of a GPX file's track points.

    Raises:
        DriveError: it is none, or has fewer than two points with a time.
    """
    times, places = [], []
    try:
        check_file(path, LARGEST_GPX)
        for point in xml_items(path, POINTS_AT, attributes=True):
            if _bare(point.tag) != "trkpt":
                continue
            stamp = next((c.text for c in point if _bare(c.tag) == "time"), None)
            try:
                times.append(datetime.fromisoformat((stamp or "").strip()).timestamp())
                places.append((float(point.get("lat", "")), float(point.get("lon", ""))))
            except ValueError:
                continue
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend="check the path of --gpx") from error
    except DriveError as error:
        raise DriveError(f"Not a GPX track: {error.problem}", path=path, mend="export the track again") from error
    if len(times) < 2 or len(times) != len(places):
        raise DriveError("has no track points with times", path=path, mend="export the track with its times")
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], np.array(places)[order]


def _bare(tag: str) -> str:
    """A tag without the prefix of its namespace."""
    return tag.rsplit(":", 1)[-1]


def level_metres(places: Sequence[tuple[float, float]] | Float64) -> Float64:
    """(N, 2) metres to the east and north of their mean, of latitudes and longitudes (N, 2) in degrees, near each other."""
    degrees = np.asarray(places, dtype=np.float64)
    middle = degrees.mean(axis=0)
    apart = np.radians(degrees - middle)
    return np.stack([apart[:, 1] * np.cos(np.radians(middle[0])), apart[:, 0]], axis=1) * EARTH_M
