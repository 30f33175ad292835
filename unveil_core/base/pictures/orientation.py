"""How a picture's file says that it is to be held: the orientation of EXIF.

Cameras are calibrated for pixels as they are stored, or as viewers show them; where width and height are swapped it matters. Facts:
EXIF 2.32, section 4.6.4; TIFF 6.0, section 8; PNG (third edition), 11.3.4.4; WebP Container Specification.
"""

from __future__ import annotations

from unveil_core.base.pictures.headers import format_of
from unveil_core.base.pictures.tiff_header import TIFF, tag_place

__all__ = ["SWAPS_SIDES", "orientation_of"]

ORIENTATION = 274
SWAPS_SIDES = (5, 6, 7, 8)
"""Orientations that are shown with width and height swapped."""
SEARCHED = 1 << 18
"""Bytes from its beginning in which a JPEG or PNG has it."""


def orientation_of(content: bytes) -> int:
    """1 to 8 of an encoded picture, 1 = as it is stored; 1 as well where it does not say."""
    kind = format_of(content)
    if kind == "TIFF":
        return _of_tiff(content)
    mark = {"JPEG": b"Exif\0\0", "PNG": b"eXIf", "WebP": b"EXIF"}.get(kind or "")
    at = -1 if mark is None else content.find(mark, 0, SEARCHED if kind != "WebP" else len(content))
    if at < 0 or mark is None:
        return 1
    start = at + len(mark) + (4 if kind == "WebP" else 0)
    rest = content[start : start + (1 << 16)]
    rest = rest.removeprefix(b"Exif\0\0")
    return _of_tiff(rest) if rest[:4] in TIFF else 1


def _of_tiff(content: bytes) -> int:
    place = tag_place(content, ORIENTATION)
    if place is None:
        return 1
    found = int.from_bytes(content[place[0] : place[0] + 2], "little" if content[:2] == b"II" else "big")
    return found if 1 <= found <= 8 else 1
