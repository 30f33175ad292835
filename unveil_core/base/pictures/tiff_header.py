"""What a TIFF says of its first picture before a pixel is decoded (TIFF 6.0, section 2).

A TIFF can hold anything in any place. What cameras, raw developers and depth sensors write is known here: grey, palette, RGB or
RGBA, packed by nothing, LZW, deflate or PackBits. Everything else is refused by name.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

__all__ = ["SIZES", "TIFF", "TiffHeader", "tag_place", "tiff_header"]

TIFF = (b"II*\0", b"MM\0*")
"""How the files begin: least or most significant byte first."""
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
"""Bytes of a value by the number of its type."""
NUMBERS = {1: "B", 3: "H", 4: "I"}
WIDTH, HEIGHT, BITS, PACKED, COLOURS, STARTS, CHANNELS, ROWS, LENGTHS = 256, 257, 258, 259, 262, 273, 277, 278, 279
TILE_WIDTH, TILE_HEIGHT, TILE_STARTS, TILE_LENGTHS = 322, 323, 324, 325
MOST_UNPACKED = {1: 1, 5: 2800, 8: 1032, 32946: 1032, 32773: 64}
"""Kinds of packing that are read, and the bytes that one byte of each makes at most: as it is; LZW, codes of 9 to 12 bits for up to
4,093 bytes; deflate, twice; PackBits."""
COLOUR_KINDS = (0, 1, 2, 3)
"""Grey from white or from black, RGB, palette."""
MOST_CHANNELS = 4
VALUE_BITS = (1, 2, 4, 8, 10, 12, 14, 16, 32, 64)
MOST_TILE = 1 << 20
"""Pixels of a tile, unless the picture itself has more: for each tile a decoder makes room as a whole."""
LISTS = frozenset((BITS, STARTS, LENGTHS, TILE_STARTS, TILE_LENGTHS))
"""Tags of several values; the others that are read have one."""
READ = LISTS | {WIDTH, HEIGHT, PACKED, COLOURS, CHANNELS, ROWS, TILE_WIDTH, TILE_HEIGHT}
MOST_PARTS = 1 << 18
"""Strips or tiles of a picture. Writers make them of 8 KB and more, or of a row."""


@dataclass(frozen=True)
class TiffHeader:
    """See :class:`unveil_core.base.pictures.headers.Header`."""

    width: int
    height: int
    whole: bool
    pixel_bytes: int
    problem: str | None


def tiff_header(content: bytes) -> TiffHeader | None:
    """The header of a TIFF's first picture, None where its size is not told."""
    tags = _tags(content)
    if tags is None:
        return None
    values, sound = tags

    def first(tag: int, usual: int) -> int:
        return (values.get(tag) or (usual,))[0]

    width, height = first(WIDTH, 0), first(HEIGHT, 0)
    channels, packed = first(CHANNELS, 1), first(PACKED, 1)
    bits = max(values.get(BITS) or (1,))
    if width < 1 or height < 1:
        return None
    problem = None
    if packed not in MOST_UNPACKED:
        problem = f"a TIFF with compression {packed}"
    elif first(COLOURS, 1) not in COLOUR_KINDS:
        problem = f"a TIFF with colours of kind {first(COLOURS, 1)}"
    elif not 1 <= channels <= MOST_CHANNELS or bits not in VALUE_BITS:
        problem = f"a TIFF of {channels} channels with {bits} bits"
    elif TILE_WIDTH in values and first(TILE_WIDTH, 0) * first(TILE_HEIGHT, 0) > max(4 * width * height, MOST_TILE):
        problem = f"a TIFF of tiles of {first(TILE_WIDTH, 0)}x{first(TILE_HEIGHT, 0)} pixels"
    stored = sum(values.get(TILE_LENGTHS) or values.get(LENGTHS) or (0,))
    needed = height * -(-width * bits * channels // 8)
    starts = values.get(TILE_STARTS) or values.get(STARTS) or (len(content),)
    within = max(starts) < len(content) and stored <= len(content)
    whole = sound and within and stored * MOST_UNPACKED.get(packed, 1) >= needed
    # A palette gives three values for each.
    pixel = max(channels, 3 if first(COLOURS, 1) == 3 else 1) * -(-bits // 8)
    return TiffHeader(width, height, whole, pixel, problem)


def _directory(content: bytes) -> tuple[str, int, int] | None:
    """Byte order of ``struct``, place and number of entries of the first directory; None where it is not in the file."""
    order = "<" if content[:2] == b"II" else ">"
    if len(content) < 8:
        return None
    (at,) = struct.unpack_from(order + "I", content, 4)
    if at + 2 > len(content):
        return None
    (count,) = struct.unpack_from(order + "H", content, at)
    return order, at, count


def tag_place(content: bytes, wanted: int) -> tuple[int, int] | None:
    """Where the values of a tag of 16-bit numbers lie in a file, in bytes, and how many they are; None where there is no such."""
    directory = _directory(content)
    if directory is None:
        return None
    order, at, count = directory
    for entry in range(at + 2, min(at + 2 + 12 * count, len(content) - 11), 12):
        tag, kind, many = struct.unpack_from(order + "HHI", content, entry)
        if tag == wanted and SIZES.get(kind) == 2:
            place = entry + 8
            if 2 * many > 4:
                (place,) = struct.unpack_from(order + "I", content, place)
            return (place, many) if many and place + 2 * many <= len(content) else None
    return None


def _tags(content: bytes) -> tuple[dict[int, tuple[int, ...]], bool] | None:
    """The numbers of the first directory by tag, and whether it is sound: each tag once, its values in the file, whole numbers in
    those that are read."""
    directory = _directory(content)
    if directory is None:
        return None
    order, at, count = directory
    if at + 2 + 12 * count > len(content):
        return None
    found: dict[int, tuple[int, ...]] = {}
    seen, sound = set[int](), True
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, many = struct.unpack_from(order + "HHI", content, entry)
        size = SIZES.get(kind, 8) * many
        place = entry + 8
        if size > 4:
            (place,) = struct.unpack_from(order + "I", content, place)
        sound &= place + size <= len(content) and tag not in seen
        seen.add(tag)
        if tag in READ and sound:
            # A decoder reads numbers of other types, too, and other counts in its own way.
            sound = kind in NUMBERS and 1 <= many <= (MOST_PARTS if tag in LISTS else 1)
            found[tag] = struct.unpack_from(f"{order}{many}{NUMBERS[kind]}", content, place) if sound else ()
    return found, sound
