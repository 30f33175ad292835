"""What PNG and JPEG files say of themselves before a pixel is decoded: their size, and whether they are whole.

A file of a hundred kilobytes can claim gigabytes of pixels; what it claims is compared with what is expected first. Facts of the
formats: W3C PNG (third edition) sections 5 and 11, ITU-T T.81 (JPEG) annex B.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SIGNATURES", "Header", "header_of"]

PNG = b"\x89PNG\r\n\x1a\n"
PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Values a pixel by the number of the colour type."""
MOST_DEFLATED = 1032
"""Bytes that one byte of a deflate stream makes at most: 258 for two bits."""
JPEG = b"\xff\xd8"
SIGNATURES = (PNG[:4], JPEG)
"""How the files begin whose headers are read here."""
PIXELS_OF_A_BYTE = 512
"""That one byte of a JPEG stands for at most, where codes are Huffman's: a bit for a block of 8x8."""
ARITHMETIC = frozenset(range(0xC9, 0xD0))
"""Markers of frames whose codes have no such limit."""
END, SCAN = 0xD9, 0xDA
SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of frames, which hold the size of the picture."""
BARE = frozenset((0x01, *range(0xD0, 0xD8)))
"""Markers without a length."""


@dataclass(frozen=True)
class Header:
    """Attributes: width, height: pixels; whole: the end of the picture is in the file, and as many bytes as it needs at least."""

    width: int
    height: int
    whole: bool


def header_of(content: bytes) -> Header | None:
    """The header of a PNG or JPEG, None of anything else and where the file ends before its size is told.

    What follows the end of the picture, as phones append it, does not matter.
    """
    if content[:8] == PNG:
        return _png(content)
    return _jpeg(content) if content[:2] == JPEG else None


def _png(content: bytes) -> Header | None:
    if len(content) < 29 or content[12:16] != b"IHDR":
        return None
    width, height = int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
    bits = content[24] * PNG_CHANNELS.get(content[25], 1)
    at, pixels, ended = 8, 0, False
    while at + 12 <= len(content) and not ended:
        size, kind = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        pixels += size if kind == b"IDAT" else 0
        ended = kind == b"IEND"
        at += 12 + size
    needed = height * (1 + -(-width * bits // 8))
    return Header(width, height, ended and at <= len(content) and pixels * MOST_DEFLATED >= needed)


def _jpeg(content: bytes) -> Header | None:
    size: tuple[int, int] | None = None
    at, scanned, most = 2, False, PIXELS_OF_A_BYTE
    while True:
        at = content.find(b"\xff", at)
        if at < 0 or at + 2 > len(content):
            break
        marker = content[at + 1]
        if marker in (0x00, 0xFF) or marker in BARE:
            at += 1 if marker == 0xFF else 2
            continue
        if marker == END:
            return None if size is None else Header(*size, scanned and size[0] * size[1] <= len(content) * most)
        length = int.from_bytes(content[at + 2 : at + 4], "big")
        if marker in SIZES and at + 9 <= len(content):
            size = int.from_bytes(content[at + 7 : at + 9], "big"), int.from_bytes(content[at + 5 : at + 7], "big")
            most = PIXELS_OF_A_BYTE << 8 if marker in ARITHMETIC else PIXELS_OF_A_BYTE
        scanned |= marker == SCAN
        at += 2 + max(length, 2)
    return None if size is None else Header(*size, False)
