"""What a camera noted with a photograph (Exif 3.0): kept for a picture that something was taken out of, and read.

Exif is a TIFF of directories without a picture. Kept are what tells camera, lens, exposure, time, place and rights. Left out is
whatever shows the photograph as it was, thumbnails and makers' notes, which hold previews; and what describes pixels that are not
there any more.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from unveil_core.base.pictures.tiff_header import SIZES, TIFF

__all__ = ["Exif", "cleaned_exif", "exif_facts"]

ORDERS = dict(zip(TIFF, "<>", strict=True))
MOST_ENTRIES, MOST_BYTES = 512, 1 << 16
"""Of a directory, and of all values: a JPEG has no room for more."""
MAKE, MODEL, ORIENTATION, TIME = 271, 272, 274, 306
PICTURE = frozenset(
    (270, MAKE, MODEL, ORIENTATION, 282, 283, 296, 305, TIME, 315, 316, 18246, 18249, 33432, *range(40091, 40096))
)
"""Tags of the first directory that are kept: description, camera, orientation, resolution, software, time, artist, host, rating,
copyright, and Windows' title, comment, author, keywords and subject."""
OF_EXIF, OF_GPS, OF_INTEROP = 34665, 34853, 40965
"""Tags that lead to other directories."""
NOTES = frozenset((37500, 59932, 59933))
"""Of the Exif directory: the maker's note, and padding."""

Entry = tuple[int, int, bytes]
"""Type, number of values, and these as they are stored."""
Directory = dict[int, Entry]


@dataclass(frozen=True)
class Exif:
    """Facts of a photograph, None where it does not tell.

    Attributes:
        make, model, lens_make, lens: as their makers call them.
        focal_mm: of the lens; exposure_s, f_number, iso.
        taken: "YYYY:MM:DD hh:mm:ss", local; utc_offset_s: of that time.
        latitude, longitude: degrees, north and east positive; altitude_m: above the sea.
        adobe_rgb: whether it says that its colours are those of Adobe RGB, as cameras without profiles do.
        focal_35mm: focal length, mm, that shows as much on film of 36 mm width.
    """

    make: str | None = None
    model: str | None = None
    lens_make: str | None = None
    lens: str | None = None
    focal_mm: float | None = None
    exposure_s: float | None = None
    f_number: float | None = None
    iso: float | None = None
    taken: str | None = None
    utc_offset_s: float | None = None
    latitude: float | None = None
    longitude: float | None = None
    altitude_m: float | None = None
    adobe_rgb: bool = False
    focal_35mm: float | None = None


def cleaned_exif(content: bytes) -> bytes | None:
    """What is kept of Exif, or of a TIFF; None where it is none or nothing is."""
    order = ORDERS.get(content[:4])
    if order is None:
        return None
    main, exif, gps, interop = _directories(content, order)
    main = {tag: entry for tag, entry in main.items() if tag in PICTURE}
    exif = {tag: entry for tag, entry in exif.items() if tag not in NOTES and tag != OF_INTEROP}
    parts = (main, exif, gps, interop)
    if not any(parts) or sum(len(entry[2]) for part in parts for entry in part.values()) > MOST_BYTES:
        return None
    return _written(order, *parts)


def exif_facts(content: bytes | None) -> Exif:
    """The facts that Exif, or a TIFF, tells; what it tells wrongly is left out."""
    order = ORDERS.get((content or b"")[:4])
    if content is None or order is None:
        return Exif()
    main, exif, gps, interop = _directories(content, order)

    def text(directory: Directory, tag: int) -> str | None:
        kind, _, raw = directory.get(tag, (0, 0, b""))
        found = raw.split(b"\0")[0].decode("utf-8", errors="replace").strip() if kind == 2 else ""
        return found if found and found.isprintable() else None

    def numbers(directory: Directory, tag: int) -> list[float]:
        return _numbers(directory[tag], order) if tag in directory else []

    def number(directory: Directory, tag: int) -> float | None:
        return next((v for v in numbers(directory, tag) if v > 0), None)

    def degrees(reference: int, tag: int, limit: float, negative: str) -> float | None:
        parts = numbers(gps, tag)
        found = sum(v / 60**k for k, v in enumerate(parts[:3])) if parts else math.nan
        sign = -1.0 if (text(gps, reference) or "").upper() == negative else 1.0
        return sign * found if 0 <= found <= limit else None

    altitude = next(iter(numbers(gps, 6)), None)
    below = gps.get(5, (0, 0, b"\0"))[2][:1] == b"\1"
    return Exif(
        text(main, MAKE),
        text(main, MODEL),
        text(exif, 42035),
        text(exif, 42036),
        number(exif, 37386),
        number(exif, 33434),
        number(exif, 33437),
        number(exif, 34855),
        text(exif, 36867) or text(main, TIME),
        _offset(text(exif, 36881) or text(exif, 36880)),
        degrees(1, 2, 90, "S"),
        degrees(3, 4, 180, "W"),
        None if altitude is None else (-altitude if below else altitude),
        text(interop, 1) == "R03" or 2 in numbers(exif, 40961),
        number(exif, 41989),
    )


def _offset(text: str | None) -> float | None:
    """Seconds of "+01:00"."""
    if text is None or len(text) != 6 or text[0] not in "+-" or text[3] != ":" or not (text[1:3] + text[4:]).isdigit():
        return None
    return (1 if text[0] == "+" else -1) * 60.0 * (60 * int(text[1:3]) + int(text[4:]))


# Directories


def _directories(content: bytes, order: str) -> tuple[Directory, Directory, Directory, Directory]:
    """The first directory, and those of Exif, of the place and of interoperability that it leads to."""
    main = _directory(content, order, content[4:8])
    exif, gps = (_directory(content, order, main.get(tag, (0, 0, b""))[2]) for tag in (OF_EXIF, OF_GPS))
    return main, exif, gps, _directory(content, order, exif.get(OF_INTEROP, (0, 0, b""))[2])


def _directory(content: bytes, order: str, pointer: bytes) -> Directory:
    """The entries at an offset; none where they are not all in the file."""
    found: Directory = {}
    at = struct.unpack(order + "I", pointer)[0] if len(pointer) == 4 else 0
    if at < 8 or at + 2 > len(content):
        return found
    count = struct.unpack_from(order + "H", content, at)[0]
    if count > MOST_ENTRIES or at + 2 + 12 * count > len(content):
        return found
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, many = struct.unpack_from(order + "HHI", content, entry)
        size = SIZES.get(kind, 0) * many
        place = entry + 8 if size <= 4 else struct.unpack_from(order + "I", content, entry + 8)[0]
        if 0 < size <= MOST_BYTES and place + size <= len(content):
            found.setdefault(tag, (kind, many, content[place : place + size]))
    return found


def _numbers(entry: Entry, order: str) -> list[float]:
    """The values of an entry of numbers; no fraction of nothing."""
    kind, many, raw = entry
    codes = {1: "B", 3: "H", 4: "I", 6: "b", 8: "h", 9: "i", 11: "f", 12: "d"}
    if kind in codes:
        return [float(v) for v in struct.unpack(f"{order}{many}{codes[kind]}", raw) if math.isfinite(v)]
    if kind not in (5, 10):
        return []
    values = struct.unpack(f"{order}{2 * many}{'I' if kind == 5 else 'i'}", raw)
    return [a / b for a, b in zip(values[::2], values[1::2], strict=True) if b]


def _written(order: str, main: Directory, exif: Directory, gps: Directory, interop: Directory) -> bytes:
    """The directories as a TIFF, one behind the other, each with its values behind it."""
    content = bytearray((b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8))
    leading: dict[int, int] = {}

    def put(directory: Directory, *pointers: int) -> None:
        entries = {**directory, **{tag: (4, 1, bytes(4)) for tag in pointers}}
        start = len(content)
        content.extend(struct.pack(order + "H", len(entries)) + bytes(12 * len(entries) + 4))
        for k, tag in enumerate(sorted(entries)):
            kind, many, raw = entries[tag]
            at = start + 2 + 12 * k
            struct.pack_into(order + "HHI", content, at, tag, kind, many)
            if tag in pointers:
                leading[tag] = at + 8
            elif len(raw) <= 4:
                content[at + 8 : at + 8 + len(raw)] = raw
            else:
                struct.pack_into(order + "I", content, at + 8, len(content))
                content.extend(raw + bytes(len(raw) % 2))

    exif_too = bool(exif or interop)
    put(main, *([OF_EXIF] if exif_too else []), *([OF_GPS] if gps else []))
    for tag, directory, pointers in (
        (OF_EXIF, exif if exif_too else None, [OF_INTEROP] if interop else []),
        (OF_GPS, gps or None, []),
        (OF_INTEROP, interop or None, []),
    ):
        if directory is not None:
            struct.pack_into(order + "I", content, leading[tag], len(content))
            put(directory, *pointers)
    return bytes(content)
