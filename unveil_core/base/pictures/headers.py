"""What pictures say of themselves before a pixel is decoded: their format, their size, and whether they are whole.

A file of a hundred kilobytes can claim gigabytes of pixels; what it claims is compared with what is expected first. A format is
known by its first bytes alone, whatever the file is called. What a decoder would do beyond one still picture, as animations, is
refused here. Facts of the formats: W3C PNG (third edition) sections 5 and 11, ITU-T T.81 (JPEG) annex B, TIFF 6.0 section 2, WebP
Container Specification and RFC 6386 section 9, BITMAPINFOHEADER.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

from unveil_core.base.pictures.tiff_header import TIFF, TiffHeader, tiff_header

__all__ = [
    "BMP",
    "MOST_CHUNKS",
    "PNG",
    "PNG_BYTES",
    "Header",
    "format_of",
    "header_of",
    "is_lossy",
    "png_start",
    "unread_format_of",
]

PNG = b"\x89PNG\r\n\x1a\n"
PNG_BYTES = 26
"""Of its beginning: signature, size, bits a channel, kind of colour."""
PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Values a pixel by the number of the colour type."""
PNG_KEPT = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
"""Chunks that make the picture. The others, as times, texts, profiles, never reach a decoder."""
PNG_ANIMATED = (b"acTL", b"fcTL", b"fdAT")
MOST_CHUNKS = 1 << 20
"""Of a PNG. Writers make them of 8 KB and more."""
MOST_DEFLATED = 1032
"""Bytes that one byte of a deflate stream makes at most: 258 for two bits."""
JPEG = b"\xff\xd8\xff"
MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd7\xff]", re.DOTALL)
"""Of a JPEG, those that have a length, and the last."""
PIXELS_OF_A_BYTE = 512
"""That one byte of a JPEG stands for at most, where codes are Huffman's: a bit for a block of 8x8."""
ARITHMETIC = frozenset(range(0xC9, 0xD0))
"""Markers of frames whose codes have no such limit."""
END, SCAN = 0xD9, 0xDA
SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of frames, which hold the size of the picture."""
MOST_SCANS = 100
"""Of a JPEG, each of which a decoder goes through for all pixels; progressive ones have about ten."""
MOST_SEGMENTS = 1 << 14
BMP = b"BM"
BMP_BITS = (1, 4, 8, 16, 24, 32)
BMP_PLAIN = (0, 3)
"""Of its kinds of compression those that are none: as they are, and with masks of the channels."""
RIFF = b"RIFF"
WEBP_HEAD = 1 << 16
"""Bytes of a WebP in which the kind of its picture is told: profiles may come before."""
OTHERS = (
    (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
    (b"\xff\x4f\xff\x51", "JPEG 2000"),
    (b"GIF8", "GIF"),
    (b"\x76\x2f\x31\x01", "OpenEXR"),
    (b"#?R", "Radiance HDR"),
    (b"II+\0", "BigTIFF"),
    (b"MM\0+", "BigTIFF"),
)
"""Formats that are not read, by how their files begin: they are told by name."""
BRANDS = {
    b"avif": "AVIF",
    b"avis": "AVIF",
    b"heic": "HEIC",
    b"heix": "HEIC",
    b"hevc": "HEIC",
    b"mif1": "HEIC",
    b"msf1": "HEIC",
}
"""The same of those that begin with the size of a box and ``ftyp``, by what follows: phones photograph in them."""


@dataclass(frozen=True)
class Header:
    """What is known of a picture that is not decoded yet.

    Attributes:
        width, height: pixels.
        whole: the end of the picture is in the file, and as many bytes as it needs at least.
        pixel_bytes: of one pixel, decoded.
        problem: why it is not decoded, else None.
        parts: first and last byte (exclusive) of what a decoder needs, in order; none = all of the file.
    """

    width: int
    height: int
    whole: bool
    pixel_bytes: int = 3
    problem: str | None = None
    parts: tuple[tuple[int, int], ...] = ()


def format_of(content: bytes) -> str | None:
    """ "PNG", "JPEG", "TIFF", "BMP" or "WebP" by the first bytes of a file, None of anything else."""
    if content[:8] == PNG:
        return "PNG"
    if content[:3] == JPEG:
        return "JPEG"
    if content[:4] in TIFF:
        return "TIFF"
    if content[:2] == BMP:
        return "BMP"
    return "WebP" if content[:4] == RIFF and content[8:12] == b"WEBP" else None


def png_start(content: bytes) -> tuple[int, int, int, int] | None:
    """Width, height, bits a channel and kind of colour, by the first :data:`PNG_BYTES` of a file; None of anything but a PNG."""
    if content[:4] != PNG[:4] or len(content) < PNG_BYTES:
        return None
    width, height = (int.from_bytes(content[at : at + 4], "big") for at in (16, 20))
    return width, height, content[24], content[25]


def unread_format_of(content: bytes) -> str | None:
    """The name of a picture's format that is known and not read, by the first bytes of a file; None of anything else."""
    if content[4:8] == b"ftyp":
        return BRANDS.get(content[8:12])
    return next((name for start, name in OTHERS if content.startswith(start)), None)


def header_of(content: bytes) -> Header | None:
    """The header of a PNG, JPEG, TIFF, BMP or WebP; None of anything else and where the file ends before its size is told.

    What follows the end of the picture, as phones append it, does not matter.
    """
    read = {"PNG": _png, "JPEG": _jpeg, "TIFF": _tiff, "BMP": _bmp, "WebP": _webp}.get(format_of(content) or "")
    return None if read is None else read(content)


def is_lossy(content: bytes) -> bool:
    """Whether a picture is of a format that changes its numbers a little: a JPEG, or a WebP that is not marked as exact."""
    kind = format_of(content)
    return kind == "JPEG" or (kind == "WebP" and b"VP8 " in content[12:WEBP_HEAD])


def _png(content: bytes) -> Header | None:
    if len(content) < 33 or content[8:16] != b"\0\0\0\rIHDR":
        return None
    width, height, depth, kind = struct.unpack_from(">IIBB", content, 16)
    bits = depth * PNG_CHANNELS.get(kind, 1)
    at, pixels, ended, heads, problem = 8, 0, False, 0, None
    parts = [(0, 8)]
    for _ in range(MOST_CHUNKS):
        if at + 12 > len(content) or ended:
            break
        size, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        after = at + 12 + size
        pixels += size if name == b"IDAT" else 0
        heads += name == b"IHDR"
        ended = name == b"IEND"
        if name in PNG_ANIMATED:
            problem = "an animated PNG"
        if name in PNG_KEPT:
            if parts[-1][1] == at:
                parts[-1] = parts[-1][0], after
            else:
                parts.append((at, after))
        at = after
    needed = height * (1 + -(-width * bits // 8))
    whole = ended and at <= len(content) and heads == 1 and pixels * MOST_DEFLATED >= needed
    return Header(width, height, whole, max(1, bits // 8) if kind != 3 else 4, problem, tuple(parts))


def _jpeg(content: bytes) -> Header | None:
    size: tuple[int, int] | None = None
    at, scans, most, channels, frames = 2, 0, PIXELS_OF_A_BYTE, 3, 0
    for _ in range(MOST_SEGMENTS):
        found = MARKER.search(content, at)
        if found is None:
            break
        at = found.start()
        marker = content[at + 1]
        if marker == END:
            if size is None:
                return None
            whole = scans > 0 and frames == 1 and size[0] * size[1] <= len(content) * most
            problem = f"a JPEG of more than {MOST_SCANS} scans" if scans > MOST_SCANS else None
            return Header(*size, whole, channels, problem)
        length = int.from_bytes(content[at + 2 : at + 4], "big")
        if marker in SIZES and at + 10 <= len(content):
            frames += 1
            if size is None:  # a decoder makes room for the first
                size = int.from_bytes(content[at + 7 : at + 9], "big"), int.from_bytes(content[at + 5 : at + 7], "big")
                channels = content[at + 9]
                most = PIXELS_OF_A_BYTE << 8 if marker in ARITHMETIC else PIXELS_OF_A_BYTE
        scans += marker == SCAN
        at += 2 + max(length, 2)
    return None if size is None else Header(*size, False, channels)


def _tiff(content: bytes) -> Header | None:
    found: TiffHeader | None = tiff_header(content)
    if found is None:
        return None
    return Header(found.width, found.height, found.whole, found.pixel_bytes, found.problem)


def _bmp(content: bytes) -> Header | None:
    if len(content) < 26:
        return None
    start, size = struct.unpack_from("<II", content, 10)
    compression = 0
    if size == 12:
        width, height, _, bits = struct.unpack_from("<HHHH", content, 18)
    elif size >= 40 and len(content) >= 54:
        width, height, _, bits, compression = struct.unpack_from("<iiHHI", content, 18)
    else:
        return None
    height = abs(height)
    if width < 1 or height < 1 or bits not in BMP_BITS:
        return None
    problem = None if compression in BMP_PLAIN else "a compressed BMP"
    row = -(-width * bits // 32) * 4
    whole = 14 + size <= start and start + row * height <= len(content)
    return Header(width, height, whole or problem is not None, 4 if bits == 32 else 3, problem)


def _webp(content: bytes) -> Header | None:
    if len(content) < 30:
        return None
    kind, first = content[12:16], content[20:30]
    problem = None
    if kind == b"VP8X":
        width, height = (int.from_bytes(first[k : k + 3], "little") + 1 for k in (4, 7))
        if first[0] & 2:
            problem = "an animated WebP"
    elif kind == b"VP8L" and first[0] == 0x2F:
        bits = int.from_bytes(first[1:5], "little")
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    elif kind == b"VP8 " and first[3:6] == b"\x9d\x01\x2a":
        width, height = (int.from_bytes(first[k : k + 2], "little") & 0x3FFF for k in (6, 8))
    else:
        return None
    return Header(width, height, 8 + int.from_bytes(content[4:8], "little") <= len(content), 4, problem)
