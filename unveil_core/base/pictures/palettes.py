"""The numbers behind a picture with a palette: decoders give its colours, but of a label picture the numbers are the labels.

The file is rewritten so that it says of itself to be grey, and then decoded as any other. Of a PNG that is its header without the
palette (W3C PNG, third edition, 11.2), of a TIFF one number of its directory (TIFF 6.0, section 8), of a BMP its palette, which is
made the identity.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.headers import BMP, MOST_CHUNKS, PNG, format_of
from unveil_core.base.pictures.tiff_header import tag_place

__all__ = ["Indexed", "indexed"]

PNG_PALETTE = 3
"""PNG's number for colour by a palette."""
TIFF_COLOURS, TIFF_BITS, TIFF_MAP = 262, 258, 320
TIFF_PALETTE, TIFF_GREY = 3, 1
BMP_HEADER = 14
"""Bytes before the second header of a BMP."""


@dataclass(frozen=True, eq=False)
class Indexed:
    """A picture with a palette.

    Attributes:
        grey: the file, rewritten; decoded it gives numbers of the palette, each times ``step``.
        step: 255 for numbers of one bit, as decoders spread few bits over a byte; 1 for those of eight.
        palette: (N, 3) uint8 RGB.
    """

    grey: bytes
    step: int
    palette: NDArray[np.uint8]


def indexed(content: bytes) -> Indexed | None:
    """What a file of a picture with a palette says; None of any other, and of a palette that is not understood."""
    read = {"PNG": _png, "TIFF": _tiff, "BMP": _bmp}.get(format_of(content) or "")
    return None if read is None else read(content)


def _png(content: bytes) -> Indexed | None:
    if len(content) < 33 or content[25] != PNG_PALETTE or content[24] not in (1, 2, 4, 8):
        return None
    header = content[16:25] + b"\0" + content[26:29]
    parts = [PNG, _chunk(b"IHDR", header)]
    palette, at = b"", 33
    for _ in range(MOST_CHUNKS):
        if at + 12 > len(content):
            break
        size, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        if name == b"PLTE":
            palette = content[at + 8 : at + 8 + size]
        elif name in (b"IDAT", b"IEND"):
            parts.append(content[at : at + 12 + size])
        at += 12 + size
    if not palette or len(palette) % 3:
        return None
    step = 255 // ((1 << content[24]) - 1)
    return Indexed(b"".join(parts), step, np.frombuffer(palette, np.uint8).reshape(-1, 3))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _tiff(content: bytes) -> Indexed | None:
    order = "<" if content[:2] == b"II" else ">"
    colours, bits, colour_map = (tag_place(content, tag) for tag in (TIFF_COLOURS, TIFF_BITS, TIFF_MAP))
    if colours is None or bits is None or colour_map is None or colour_map[1] != 3 * 256:
        return None
    if struct.unpack_from(order + "H", content, colours[0]) != (TIFF_PALETTE,):
        return None
    if struct.unpack_from(order + "H", content, bits[0]) != (8,):
        return None
    levels = np.frombuffer(content, f"{order}u2", 3 * 256, colour_map[0])
    grey = bytearray(content)
    struct.pack_into(order + "H", grey, colours[0], TIFF_GREY)
    return Indexed(bytes(grey), 1, (levels.reshape(3, 256).T >> 8).astype(np.uint8))


def _bmp(content: bytes) -> Indexed | None:
    if len(content) < 54 or content[:2] != BMP:
        return None
    start, size = struct.unpack_from("<II", content, 10)
    (bits,) = struct.unpack_from("<H", content, 28)
    count = (start - BMP_HEADER - size) // 4
    if size < 40 or bits != 8 or not 1 <= count <= 256 or start > len(content):
        return None
    first = BMP_HEADER + size
    palette = np.frombuffer(content, np.uint8, 4 * count, first).reshape(-1, 4)[:, 2::-1]
    grey = bytearray(content)
    for k in range(count):
        grey[first + 4 * k : first + 4 * k + 4] = bytes((k, k, k, 0))
    return Indexed(bytes(grey), 1, palette.copy())
