# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture sequences as Blender wants them: numbered without gaps. No bpy here.

A drive's frames may have any names; where these are no such numbers, numbered copies of them are made in ``blender/`` of the
workspace. No file that is shown shares its bytes with one outside.
"""

from __future__ import annotations

import re
import stat
import struct
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .files import copied, discard, free_name, move, own_folder, set_time_of, write_whole
from .open_safely import LARGEST_PICTURE, read_bytes

__all__ = [
    "COLORS",
    "ORIGIN_COLORS",
    "REGION_COLORS",
    "PictureSequence",
    "in_color",
    "number_of",
    "numbered",
    "pictures_in",
    "transparent",
    "with_palette",
]

REGION_COLORS = ((0, 0, 0), (60, 120, 216), (106, 190, 90), (226, 60, 60))
"""sRGB of nothing removed, observed, seen from other views, never seen."""
ORIGIN_COLORS = ((0, 0, 0), (60, 120, 216), (106, 190, 90), (240, 200, 60), (226, 60, 60))
"""sRGB of the footage's own pixels, relit, seen elsewhere, continued, invented."""
COLORS = {"regions": REGION_COLORS, "provenance": ORIGIN_COLORS}
"""Of each kind of picture whose values are numbers."""

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
"""What mattes may be, as the command takes them."""


@dataclass(frozen=True)
class PictureSequence:
    """Files that Blender reads as one sequence.

    Attributes:
        files: in order, numbered one by one.
        first: number of the first.
    """

    files: tuple[Path, ...]
    first: int

    def __len__(self) -> int:
        return len(self.files)


def pictures_in(folder: str | Path) -> list[Path]:
    """The pictures in a folder and those below it."""
    return sorted(p for p in Path(folder).rglob("*") if p.suffix.lower() in PICTURES and not p.name.startswith("."))


NUMBER = re.compile(r"(?:.*[A-Za-z].*\.)?([0-9]+)")
"""A number, or one after a dot and a name; 1533.25 is a time."""


def number_of(stem: str) -> str:
    """The digits of a file's stem that is a number, or a name, a dot and a number; empty for others."""
    found = NUMBER.fullmatch(stem)
    return found[1] if found else ""


def _numbers(files: Sequence[Path]) -> int | None:
    """Number of the first file where they are numbered one by one in one folder, else None."""
    begins = {f.stem[: -len(number_of(f.stem))] for f in files}
    stems = [number_of(f.stem) for f in files]
    alike = len({(len(f.stem), f.suffix, f.parent) for f in files}) == len(begins) == 1
    if not alike or not all(stems):
        return None
    first = int(stems[0])
    if first > 1_000_000 or any(int(s) != first + i for i, s in enumerate(stems)):
        return None
    return first


SIGNATURE = b"\x89PNG\r\n\x1a\n"
MADE = re.compile(r"\d{6}\.[a-z]{1,5}")
"""Names of the copies that :func:`numbered` makes."""


def numbered(files: Sequence[Path], workspace: Path, *names: str) -> PictureSequence:
    """A sequence of files; where their names are none, or one is a hard link, of copies in a folder of these ``names`` in the
    workspace: whoever paints on what is shown and saves it must not write in a photograph elsewhere.

    Raises:
        OSError: the copies cannot be made, or the folder is a link.
    """
    first = _numbers(files)
    if first is not None and not any(map(_is_shared, files)):
        return PictureSequence(tuple(files), first)
    folder = own_folder(workspace, *names)
    made = []
    for i, file in enumerate(files):
        target = folder / f"{i:06d}{file.suffix.lower()}"
        if not _same(target, file):
            _keep_painted(target, file)
            copied(file, target)
        made.append(target)
    # Only what was made here before: the folder may hold, or be, something else.
    for left in set(folder.iterdir()) - set(made):
        if MADE.fullmatch(left.name):
            discard(left)
    return PictureSequence(tuple(made), 0)


def _keep_painted(target: Path, file: Path) -> None:
    """Put a copy aside that somebody saved after the file was written: he painted on it."""
    try:
        painted = target.lstat()
        if not stat.S_ISREG(painted.st_mode) or painted.st_nlink > 1 or painted.st_mtime_ns <= file.stat().st_mtime_ns:
            return
    except OSError:
        return
    move(target, free_name(target, "_painted"))


def _is_shared(file: Path) -> bool:
    """Whether a file is known by another name, too: workspaces of versions before have hard links to the photographs."""
    try:
        return file.stat().st_nlink > 1
    except OSError:
        return False


def _same(target: Path, file: Path) -> bool:
    """Whether a copy is still that of the file, which may have been written anew; versions before made hard links."""
    try:
        a, b = target.lstat(), file.stat()
    except OSError:
        return False
    shared = (a.st_ino, a.st_dev) == (b.st_ino, b.st_dev)
    return stat.S_ISREG(a.st_mode) and not shared and (a.st_size, a.st_mtime_ns) == (b.st_size, b.st_mtime_ns)


def in_color(regions: Path, target: Path, colors: Sequence[tuple[int, int, int]] = REGION_COLORS) -> None:
    """Write a copy of a picture of numbers that shows each in its colour; one that has the picture's time is left as it is.

    Raises:
        ValueError: it is no such picture; one line that names it.
        OSError: one cannot be read or written.
    """
    time = regions.stat().st_mtime_ns
    with suppress(OSError):  # it is not there yet
        if target.stat().st_mtime_ns == time:
            return
    try:
        content = with_palette(read_bytes(regions, LARGEST_PICTURE), colors)
    except ValueError as error:
        raise ValueError(f"{regions}: {error}") from error
    write_whole(target, content, like=regions)
    with suppress(OSError):  # where times cannot be set, it is written at each load
        set_time_of(target, regions)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def transparent() -> bytes:
    """A PNG of one pixel that shows nothing."""
    header = struct.pack(">IIBBBBB", 1, 1, 8, 6, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(5))), (b"IEND", b""))
    return SIGNATURE + b"".join(_chunk(kind, content) for kind, content in parts)


def with_palette(png: bytes, colors: Sequence[tuple[int, int, int]]) -> bytes:
    """A grey 8-bit PNG of small numbers as one that shows each number in a colour; the pixels are taken over as they are.

    Raises:
        ValueError: it Not a grey 8-bit PNG.
    """
    header = struct.unpack(">IIBBBBB", png[16:29]) if png[:8] == SIGNATURE and len(png) > 33 else ()
    if header[2:4] != (8, 0):
        raise ValueError("Not a grey 8-bit PNG")
    palette = bytes(v for color in (*colors, *[(255, 255, 255)] * (256 - len(colors))) for v in color)
    start = png[:8] + _chunk(b"IHDR", struct.pack(">IIBBBBB", *header[:3], 3, *header[4:])) + _chunk(b"PLTE", palette)
    rest = png[33:]
    kept, place = [], 0
    while place + 12 <= len(rest):  # gamma and the like of a grey picture do not go with a palette
        (length,) = struct.unpack(">I", rest[place : place + 4])
        kind, end = rest[place + 4 : place + 8], place + 12 + length
        if kind in (b"IDAT", b"IEND"):
            kept.append(rest[place:end])
        place = end
    return start + b"".join(kept)
