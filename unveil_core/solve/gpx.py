"""Tracks of GPS receivers: GPX files, and the places that photographs note."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from unveil_core.base.disk.open_safely import read_bytes
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64

__all__ = ["level_metres", "read_gpx"]

EARTH_M = 6_378_137.0
LARGEST_GPX = 1 << 26
"""Bytes: a week at a point a second."""


def read_gpx(path: Path) -> tuple[Float64, Float64]:
    """(T,) seconds since 1970, rising, and (T, 2) latitude and longitude in degrees, of a GPX file's track points.

    Raises:
        DriveError: it is none, or has fewer than two points with a time.
    """
    try:
        content = read_bytes(path, LARGEST_GPX)
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend="check the path of --gpx") from error
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:  # entities of strangers' XML grow without end
        raise DriveError("Not a GPX track: it declares entities", path=path, mend="export the track again")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise DriveError(f"Not a GPX track: {error}", path=path, mend="export the track again") from error
    times, places = [], []
    for point in root.iter():
        if point.tag.rsplit("}", 1)[-1] != "trkpt":
            continue
        stamp = next((c.text for c in point if c.tag.rsplit("}", 1)[-1] == "time"), None)
        try:
            times.append(datetime.fromisoformat((stamp or "").strip()).timestamp())
            places.append((float(point.get("lat", "")), float(point.get("lon", ""))))
        except ValueError:
            continue
    if len(times) < 2 or len(times) != len(places):
        raise DriveError("has no track points with times", path=path, mend="export the track with its times")
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], np.array(places)[order]


def level_metres(places: Sequence[tuple[float, float]] | Float64) -> Float64:
    """(N, 2) metres to the east and north of their mean, of latitudes and longitudes (N, 2) in degrees, near each other."""
    degrees = np.asarray(places, dtype=np.float64)
    middle = degrees.mean(axis=0)
    apart = np.radians(degrees - middle)
    return np.stack([apart[:, 1] * np.cos(np.radians(middle[0])), apart[:, 0]], axis=1) * EARTH_M
