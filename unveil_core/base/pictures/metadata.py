"""What comes with a picture's pixels and says what they mean: its colour profile, and what camera and programs noted (Exif, XMP).

It is found in a JPEG, PNG, TIFF or WebP by the places that these formats have for it (ITU-T T.81 annex B with the ICC's, Exif's and
Adobe's markers, W3C PNG third edition, TIFF 6.0, WebP Container Specification), and put into a PNG. What is damaged is left out:
the pixels are what matters, and nothing here fails for the rest.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

from unveil_core.base.pictures.exif import cleaned_exif
from unveil_core.base.pictures.headers import PNG, format_of
from unveil_core.base.pictures.xmp import cleaned_xmp

__all__ = ["Metadata", "metadata_of"]

MOST_PROFILE = 1 << 22
"""Bytes of a colour profile: those of printers, the largest, have two million."""
XMP_OF_PNG = b"XML:com.adobe.xmp"
SPACES = (b"RGB ", b"GRAY", b"CMYK", b"Lab ")
"""Colours of a picture, as a profile names them."""
OF_COLOR = (b"cICP", b"sRGB", b"gAMA", b"cHRM")
"""Chunks of a PNG that say what its colours are, beside a profile."""
KEPT = frozenset((*OF_COLOR, b"iCCP", b"eXIf", b"iTXt", b"pHYs"))
TIFF_PROFILE, TIFF_XMP = 34675, 700
SEGMENT = re.compile(rb"\xff+([\xc0-\xfe])", re.DOTALL)


@dataclass(frozen=True)
class Metadata:
    """What a delivered picture takes over.

    Attributes:
        profile: an ICC profile; exif: see :func:`unveil_core.base.pictures.exif.cleaned_exif`; xmp: likewise.
        chunks: of a PNG, name and content, that say what its colours are and how large it is to be printed.
    """

    profile: bytes | None = None
    exif: bytes | None = None
    xmp: bytes | None = None
    chunks: tuple[tuple[bytes, bytes], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.profile or self.exif or self.xmp or self.chunks)

    @property
    def of_color(self) -> Metadata:
        """Only what says what the colours are: for pictures that no camera took."""
        return Metadata(self.profile, chunks=tuple(c for c in self.chunks if c[0] in OF_COLOR))

    def chunk(self, name: bytes) -> bytes | None:
        """The content of a chunk, None without one."""
        return next((content for own, content in self.chunks if own == name), None)

    def in_png(self, content: bytes) -> bytes:
        """The bytes of a PNG with this in it, in the place of what it had; a profile only where it is for pictures of its kind."""
        if not self or content[:8] != PNG:
            return content
        grey = content[25] in (0, 4)
        mine = list(self.chunks)
        if self.profile and self.profile[16:20] == (b"GRAY" if grey else b"RGB "):
            mine = [c for c in mine if c[0] != b"sRGB"]
            mine.insert(0, (b"iCCP", b"ICC profile\0\0" + zlib.compress(self.profile, 9)))
        if self.exif:
            mine.append((b"eXIf", self.exif))
        if self.xmp:
            mine.append((b"iTXt", XMP_OF_PNG + b"\0\0\0\0\0" + self.xmp))
        names = {name for name, _ in mine}
        parts = [PNG]
        for name, body in _chunks(content):
            if name not in names:
                parts.append(_chunk(name, body))
            if name == b"IHDR":
                parts += [_chunk(*own) for own in mine]
        return b"".join(parts)


def _is_profile(content: bytes) -> bool:
    """Whether bytes have the mark of a colour profile, and name colours that pictures have."""
    return 128 < len(content) <= MOST_PROFILE and content[36:40] == b"acsp" and content[16:20] in SPACES


def metadata_of(content: bytes) -> Metadata:
    """What the file of a picture holds beside its pixels."""
    read = {"JPEG": _jpeg, "PNG": _png, "TIFF": _tiff, "WebP": _webp}.get(format_of(content) or "")
    found = Metadata() if read is None else read(content)
    profile = found.profile
    if profile is not None and not _is_profile(profile):
        profile = None
    exif = None if found.exif is None else cleaned_exif(found.exif.removeprefix(b"Exif\0\0"))
    return replace(found, profile=profile, exif=exif, xmp=None if found.xmp is None else cleaned_xmp(found.xmp))


def _jpeg(content: bytes) -> Metadata:
    exif = xmp = None
    parts: dict[int, bytes] = {}
    count = 0
    for marker, body in _segments(content):
        if marker == 0xE1 and body.startswith(b"Exif\0\0"):
            exif = exif or body
        elif marker == 0xE1 and body.startswith(b"http://ns.adobe.com/xap/1.0/\0"):
            xmp = xmp or body[29:]
        elif marker == 0xE2 and body.startswith(b"ICC_PROFILE\0") and len(body) > 14:
            parts.setdefault(body[12], body[14:])
            count = body[13]
    whole = bool(parts) and sorted(parts) == list(range(1, count + 1))
    return Metadata(b"".join(parts[k] for k in sorted(parts)) if whole else None, exif, xmp)


def _segments(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Marker and content of the segments before the picture."""
    at = 2
    while (found := SEGMENT.search(content, at)) is not None:
        marker, at = found.group(1)[0], found.end()
        if marker in (0xD9, 0xDA) or at + 2 > len(content):
            return
        size = int.from_bytes(content[at : at + 2], "big")
        yield marker, content[at + 2 : at + size]
        at += max(size, 2)


def _png(content: bytes) -> Metadata:
    found = Metadata()
    kept: dict[bytes, bytes] = {}
    for name, body in _chunks(content, sound=KEPT):
        if name == b"iCCP" and found.profile is None:
            found = replace(found, profile=_unpacked(body.partition(b"\0")[2][1:], MOST_PROFILE))
        elif name == b"eXIf":
            found = replace(found, exif=body)
        elif name == b"iTXt" and body.startswith(XMP_OF_PNG + b"\0"):
            found = replace(found, xmp=_text(body[len(XMP_OF_PNG) + 1 :]))
        elif name in OF_COLOR or name == b"pHYs":
            kept.setdefault(name, body)
    return replace(found, chunks=tuple(kept.items()))


def _text(body: bytes) -> bytes | None:
    """The text of an iTXt behind its keyword."""
    packed, rest = body[:1] == b"\1", body[2:].split(b"\0", 2)
    if len(rest) < 3:
        return None
    return _unpacked(rest[2], 1 << 20) if packed else rest[2]


def _unpacked(content: bytes, most: int) -> bytes | None:
    """What a zlib stream holds, None where that is damaged or more than ``most`` bytes."""
    unpack = zlib.decompressobj()
    try:
        found = unpack.decompress(content, most)
    except zlib.error:
        return None
    return found if unpack.eof else None


def _chunks(content: bytes, sound: frozenset[bytes] = frozenset()) -> Iterator[tuple[bytes, bytes]]:
    """Name and content of the chunks of a PNG; of the names in ``sound`` those that are as they were written."""
    at = 8
    while at + 12 <= len(content):
        size, name = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        if at + 12 + size > len(content):
            return
        body, check = content[at + 8 : at + 8 + size], content[at + 8 + size : at + 12 + size]
        if name not in sound or zlib.crc32(name + body) == int.from_bytes(check, "big"):
            yield name, body
        at += 12 + size
        if name == b"IEND":
            return


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def _tiff(content: bytes) -> Metadata:
    order = "<" if content[:2] == b"II" else ">"
    at = struct.unpack_from(order + "I", content, 4)[0] if len(content) >= 8 else 0
    found: dict[int, bytes] = {}
    if 8 <= at <= len(content) - 2:
        count = struct.unpack_from(order + "H", content, at)[0]
        for entry in range(at + 2, min(at + 2 + 12 * count, len(content) - 11), 12):
            tag, kind, many, place = struct.unpack_from(order + "HHII", content, entry)
            if tag in (TIFF_PROFILE, TIFF_XMP) and kind in (1, 7) and many > 4 and place + many <= len(content):
                found.setdefault(tag, content[place : place + many])
    return Metadata(found.get(TIFF_PROFILE), content, found.get(TIFF_XMP))


def _webp(content: bytes) -> Metadata:
    found: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= len(content):
        size = int.from_bytes(content[at + 4 : at + 8], "little")
        found.setdefault(content[at : at + 4], content[at + 8 : at + 8 + size])
        at += 8 + size + size % 2
    return Metadata(found.get(b"ICCP"), found.get(b"EXIF"), found.get(b"XMP "))
