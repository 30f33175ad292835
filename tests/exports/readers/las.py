"""LAS 1.4 by the tables of its standard (R15), and by the rules with which PDAL opens it: QGIS, GRASS and untwine read by PDAL."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Las", "open_as_pdal"]

BASE = {6: 30, 7: 36}
"""Bytes of a record by its format, before extra bytes."""


@dataclass
class Las:
    """A header, and the text of the coordinate system that a reader finds, "" for none."""

    point_format: int
    count: int
    width: int
    first: int
    compressed: bool
    system: str


def open_as_pdal(path: Path) -> Las:
    """The header and coordinate system of a file; a ValueError where PDAL refuses it."""
    content = path.read_bytes()
    encoding = struct.unpack_from("<H", content, 6)[0]
    head, first, records = struct.unpack_from("<HII", content, 94)
    kind, width = struct.unpack_from("<BH", content, 104)
    (count,) = struct.unpack_from("<Q", content, 247)
    found = Las(kind & 0x3F, count, width, first, bool(kind & 0x80), "")
    if content[:4] != b"LASF" or content[24:26] != bytes((1, 4)) or head != 375:
        raise ValueError("not LAS 1.4")
    if found.point_format >= 6 and not encoding & 16:
        raise ValueError("Global encoding WKT flag not set for point format 6 - 10.")
    if struct.unpack_from("<I", content, 107)[0]:
        raise ValueError("point formats from 6 on have no legacy count")
    if width < BASE[found.point_format] or (not found.compressed and first + count * width != len(content)):
        raise ValueError("the points are not where the header says")
    at = head
    for _ in range(records):
        user = content[at + 2 : at + 18].split(b"\0")[0]
        number, size = struct.unpack_from("<HH", content, at + 18)
        body = content[at + 54 : at + 54 + size]
        if user == b"LASF_Projection" and number in (34735, 34736, 34737):
            raise ValueError("GeoTIFF keys where the header says WKT")
        if user == b"LASF_Projection" and number == 2112:
            found.system = body.rstrip(b"\0").decode()
        at += 54 + size
    if at != first:
        raise ValueError("records do not end where the points begin")
    return found
