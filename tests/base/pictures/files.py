"""Pictures made byte by byte, as no encoder writes them."""

from __future__ import annotations

import struct
import zlib

__all__ = ["animated_png", "chunk", "jpeg2000", "tiff"]


def chunk(kind: bytes, data: bytes) -> bytes:
    """One chunk of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def animated_png(width: int, height: int, frame: tuple[int, int, int, int], kinds: str = "acTL fcTL fdAT") -> bytes:
    """An APNG of two frames with those of the three chunks that are named.

    Args:
        frame: x, y, width and height of the second.
    """
    rows = bytes((1 + 3 * width) * height)
    control = struct.pack(">5IHHBB", 1, frame[2], frame[3], frame[0], frame[1], 1, 10, 0, 0)
    first = struct.pack(">5IHHBB", 0, width, height, 0, 0, 1, 10, 0, 0)
    data = struct.pack(">I", 2) + zlib.compress(bytes((1 + 3 * frame[2]) * frame[3]))
    own = {
        "acTL": chunk(b"acTL", struct.pack(">II", 2, 0)),
        "fcTL": chunk(b"fcTL", control),
        "fdAT": chunk(b"fdAT", data),
    }
    kept = [own[k] for k in ("fcTL", "fdAT") if k in kinds]
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
            own["acTL"] if "acTL" in kinds else b"",
            chunk(b"fcTL", first) if "fcTL" in kinds else b"",
            chunk(b"IDAT", zlib.compress(rows)),
            *kept,
            chunk(b"IEND", b""),
        ]
    )


def jpeg2000(width: int, height: int, stream: bytes = b"") -> bytes:
    """A JPEG 2000 file whose codestream ends early."""

    def box(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", 8 + len(content)) + kind + content

    head = box(b"ihdr", struct.pack(">IIHBBBB", height, width, 3, 7, 7, 0, 0))
    head += box(b"colr", struct.pack(">BBBI", 1, 0, 0, 16))
    start = box(b"jP  ", b"\r\n\x87\n") + box(b"ftyp", b"jp2 " + struct.pack(">I", 0) + b"jp2 ")
    return start + box(b"jp2h", head) + box(b"jp2c", stream)


def tiff(tags: dict[int, tuple[int, int]], data: bytes = b"") -> bytes:
    """A TIFF of tags (kind, value), with the data of its one strip behind, whose place the tag 273 gets."""
    at = 8 + 2 + 12 * len(tags) + 4
    entries = b"".join(
        struct.pack("<HHII", tag, kind, 1, at if tag == 273 else value) for tag, (kind, value) in tags.items()
    )
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + data
