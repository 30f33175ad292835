"""The coordinate system that a user says a drive's coordinates are of, by its EPSG codes: ``25832``, or with that of heights,
``25832+7837``. No format of drives tells it, and a wrong one puts a street into another town: what it says of units, axes and place
is compared with the drive.
"""

from __future__ import annotations

import math
import re
from importlib.util import find_spec
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Drive

__all__ = ["wkt_of"]

CODES = re.compile(r"(?:EPSG:)?(\d{4,6})(?:\+(\d{4,6}))?", re.IGNORECASE)
UNIT_OFF = 0.02
"""Share by which a drive's unit may differ from the system's: scales that were estimated are off by more, feet by much more."""
BESIDE_DEG = 1.0
"""How far from the area of a system, degrees, a drive may lie: people use a system a little beyond."""
UP_Z = 0.98
"""Least z of the drive's upward direction: z is the height."""


def wkt_of(epsg: str, drive: Drive) -> str | None:
    """The system as text in the form that LAS asks for (WKT 1, OGC 01-009); None where none is named.

    Args:
        epsg: as the user gave it, "" for none.
        drive: imported, whose coordinates are of it.
    Raises:
        SettingsError: no such system, not one of metres or feet, not that of the drive; or pyproj is not installed.
    """
    if not epsg:
        return None
    codes = CODES.fullmatch(epsg.strip())
    if codes is None:
        raise SettingsError(
            f"Not an EPSG code: --epsg {epsg[:40]}", mend="give a number, as 25832, or two, as 25832+7837"
        )
    if find_spec("pyproj") is None:
        mend = "pip install '.[exports]' in the folder of Unveil, or leave --epsg out"
        raise SettingsError("Not installed: pyproj, which --epsg needs", mend=mend)
    import pyproj

    name = "EPSG:" + "+".join(code for code in codes.groups() if code)
    try:
        system = pyproj.CRS.from_user_input(name)
        level = system.sub_crs_list[0] if system.is_compound else system
        if not level.is_projected:
            raise SettingsError(
                f"{name} does not measure on a plane", mend="name a projected system, as that of a UTM zone"
            )
        _check(level, name, drive)
        text = system.to_wkt("WKT1_GDAL")
    except pyproj.exceptions.CRSError as error:
        raise SettingsError(
            f"Not a coordinate system that can be written: {name}", mend="look the code up at epsg.io"
        ) from error
    if not text:
        raise SettingsError(
            f"{name} cannot be written as LAS asks for it", mend="name an older system of the same place"
        )
    return str(text)


def _check(system: Any, name: str, drive: Drive) -> None:
    """Raise a SettingsError where a projected system cannot be that of the drive's coordinates."""
    import pyproj

    mend = "name the system of the drive's own coordinates, or leave --epsg out"
    place = drive.to_world
    metres, theirs = 1 / place.scale, float(system.axis_info[0].unit_conversion_factor)
    if abs(metres / theirs - 1) > UNIT_OFF:
        raise SettingsError(f"a unit of the drive is {metres:.4g} m, one of {name} is {theirs:.4g} m", mend=mend)
    if place.up[2] < UP_Z:
        raise SettingsError(f"Up differs: {name} has z up, and the drive's coordinates do not", mend=mend)
    area = system.area_of_use
    if area is None:
        return
    degrees = pyproj.Transformer.from_crs(system, system.geodetic_crs, always_xy=True)
    east, north = degrees.transform(*place.translation[:2].tolist())
    width = (area.east - area.west) % 360 or 360.0
    inside = math.isfinite(east) and math.isfinite(north)
    inside = inside and (east - area.west + BESIDE_DEG) % 360 <= width + 2 * BESIDE_DEG
    if not (inside and area.south - BESIDE_DEG <= north <= area.north + BESIDE_DEG):
        where = f"at {north:.2f} degrees north, {east:.2f} east" if math.isfinite(east + north) else "nowhere on earth"
        raise SettingsError(f"by {name} the drive lies {where}, outside of its area ({area.name})", mend=mend)
