"""Profile and notes of a picture as segments of a JPEG: ITU-T T.81 annex B, Exif 2.32, ICC.1:2022 annex B.4, XMP part 3."""

from __future__ import annotations

from unveil_core.base.pictures.metadata import Metadata

__all__ = ["in_jpeg"]

EXIF, XMP, ICC = b"Exif\0\0", b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0"
APP1, APP2 = 0xE1, 0xE2
MOST = 65533
"""Bytes in a segment, less the two of its length."""
PART = MOST - len(ICC) - 2
"""Bytes of a profile in a segment."""
JFIF = 0xE0


def in_jpeg(content: bytes, metadata: Metadata) -> bytes:
    """The bytes of a JPEG with what goes with the picture behind its JFIF segment; what is too long for a segment is left out."""
    segments = b""
    for head, body in ((EXIF, metadata.exif), (XMP, metadata.xmp)):
        if body and len(head) + len(body) <= MOST:
            segments += _segment(APP1, head + body)
    profile = metadata.profile or b""
    parts = [profile[k : k + PART] for k in range(0, len(profile), PART)]
    if len(parts) < 256:
        for number, part in enumerate(parts, start=1):
            segments += _segment(APP2, ICC + bytes((number, len(parts))) + part)
    start = 2
    if content[2:4] == bytes((0xFF, JFIF)):
        start = 4 + int.from_bytes(content[4:6], "big")
    return content[:start] + segments + content[start:]


def _segment(marker: int, body: bytes) -> bytes:
    return bytes((0xFF, marker)) + (len(body) + 2).to_bytes(2, "big") + body
