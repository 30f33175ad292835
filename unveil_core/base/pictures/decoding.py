"""Decoding pictures: the one place where bytes of a file become pixels.

A decoder of a library sees a file only when its first bytes say that it is a PNG, JPEG, TIFF, BMP or WebP of one still picture,
when its header was compared with its camera and with what fits into memory, and of a PNG no more than the chunks that make the
picture.
Other formats that OpenCV could read, among them JPEG 2000, are refused: few use them for photographs, and their decoders have
written where they must not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import read_bytes
from unveil_core.base.errors import DriveError
from unveil_core.base.files import is_out_of_memory
from unveil_core.base.pictures.headers import Header, format_of, header_of, is_lossy, unread_format_of
from unveil_core.base.pictures.levels import as_bytes, levels_of
from unveil_core.base.pictures.metadata import Metadata, metadata_of
from unveil_core.base.pictures.orientation import SWAPS_SIDES, orientation_of
from unveil_core.base.pictures.palettes import indexed
from unveil_core.base.types import Levels

__all__ = [
    "Values",
    "decode_image",
    "decode_levels",
    "decode_unchanged",
    "read_image",
    "read_image_as_it_is",
    "read_instance_image",
    "read_label_image",
    "read_levels",
    "read_metadata",
    "read_unchanged",
    "read_values",
    "size_of_image",
]

IN_COLOR = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
"""Pixels as they are stored: cameras are calibrated for these, whatever a maker's note says of how to hold the picture."""
MOST_PIXELS = 1 << 28
"""Of an image, 800 MB as RGB: twice what the largest cameras take. OpenCV is told the same, see ``unveil_core/__init__.py``."""
MOST_BYTES = 1 << 31
"""Of its pixels: RGBA of 16 bits."""
AGAIN = "export it again as PNG or JPEG"
FROM_SOURCE = "copy it again from its source, or drop the frame"


def _content_of(path: Path) -> bytes:
    """What the file of a picture holds.

    Raises:
        DriveError: missing, a pipe, a device, or no name of a file.
    """
    try:
        return read_bytes(path)
    except FileNotFoundError as error:
        raise DriveError("Not found", path=path, mend="restore it or drop the frame") from error
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path) from error
    except ValueError as error:
        raise DriveError("Not the name of a file", path=ascii(str(path)), mend="correct it") from error


def _header(content: bytes, path: Path) -> Header:
    """The header of a picture that may be decoded.

    Raises:
        DriveError: empty, of another format, cut short, animated or packed in ways that cameras do not use.
    """
    if not content:
        raise DriveError("Empty", path=path, mend=FROM_SOURCE)
    if format_of(content) is None:
        other = unread_format_of(content)
        problem = "Not a readable image" if other is None else f"Not read: {other}"
        raise DriveError(problem, path=path, mend=AGAIN)
    header = header_of(content)
    if header is None:
        raise DriveError("Cut short", path=path, mend="copy it again from its source")
    if header.problem is not None:
        raise DriveError(f"Not read: {header.problem}", path=path, mend=AGAIN)
    return header


def _decode(content: bytes, path: Path, flags: int, size: tuple[int, int] | None = None) -> NDArray[np.generic]:
    """Decode a picture; ``size`` (width, height) is what its camera says, None = any."""
    header = _header(content, path)
    _check_size(path, (header.width, header.height), size, content)
    if header.width * header.height * header.pixel_bytes > MOST_BYTES:
        raise DriveError(
            f"claims {header.width}x{header.height} pixels of {header.pixel_bytes} bytes", path=path, mend=AGAIN
        )
    if not header.whole:
        raise DriveError("Cut short", path=path, mend="copy it again from its source")
    if header.parts not in ((), ((0, len(content)),)):
        content = b"".join(content[start:end] for start, end in header.parts)
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error as error:
        if is_out_of_memory(error):  # nothing is wrong with the file: its size was looked at before
            raise MemoryError(str(error)) from error
        image = None
    if image is None:
        raise DriveError("Not a readable image", path=path, mend=AGAIN)
    _check_size(path, (image.shape[1], image.shape[0]), size)
    return image


def size_of_image(content: bytes, path: Path) -> tuple[int, int]:
    """(width, height) of an encoded image, of which the beginning may be enough; nothing is decoded.

    Raises:
        DriveError: empty, or of a format that is not read.
    """
    header = _header(content, path)
    return header.width, header.height


def decode_unchanged(content: bytes, path: Path, size: tuple[int, int] | None = None) -> NDArray[np.generic]:
    """(H, W) or (H, W, C) of an encoded image, with its values and its order of channels; see :func:`decode_image`."""
    return _decode(content, path, cv2.IMREAD_UNCHANGED, size)


def _check_size(path: Path, found: tuple[int, int], wanted: tuple[int, int] | None, content: bytes = b"") -> None:
    """Raise a DriveError where an image has another size (width, height) than its camera, or is too large for any; ``content``: its
    file, which may say that it is to be turned."""
    if wanted is not None and found == wanted[::-1]:
        turned, stored, shown = orientation_of(content), f"{found[0]}x{found[1]}", f"{wanted[0]}x{wanted[1]}"
        if turned in SWAPS_SIDES:
            problem = f"Stored with {stored} pixels, and only EXIF turns it to the {shown} of its camera ({turned})"
            mend = "calibrate the stored pixels and turn the poses with them, or turn the files themselves, as exiftran -ai does"
        else:
            problem, mend = (
                f"Not the size of its camera: {stored} pixels, the camera says {shown}",
                "width and height are swapped: correct w and h",
            )
        raise DriveError(problem, path=path, mend=mend)
    if wanted is not None and found != wanted:
        raise DriveError(
            f"Not the size of its camera: {found[0]}x{found[1]} pixels, the camera says {wanted[0]}x{wanted[1]}",
            path=path,
            mend="resize the image or correct w and h",
        )
    if found[0] * found[1] > MOST_PIXELS:
        raise DriveError(
            f"claims {found[0]}x{found[1]} pixels", path=path, mend=f"images have {MOST_PIXELS:,} pixels at most"
        )


def decode_image(content: bytes, path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of an encoded image.

    Args:
        path: of what it was read from, for messages.
        size: (width, height) that it must have, compared before a pixel is decoded; None = any.
    Raises:
        DriveError: unreadable, cut short, or of another size.
    """
    return as_bytes(decode_levels(content, path, size))


def decode_levels(content: bytes, path: Path, size: tuple[int, int] | None = None) -> Levels:
    """The same with all bits that it has."""
    image = _decode(content, path, IN_COLOR | cv2.IMREAD_ANYDEPTH, size)
    if image.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):  # OpenCV knows how it means these to be seen
        image = _decode(content, path, IN_COLOR, size)
    return levels_of(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def read_image_as_it_is(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """(H, W), (H, W, 3) RGB or (H, W, 4) RGBA, with 8 or 16 bits as the file has them.

    Raises:
        DriveError: missing, unreadable or cut short.
    """
    image = _decode(_content_of(path), path, cv2.IMREAD_UNCHANGED)
    order = {3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGBA}
    if image.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise DriveError(f"has {image.dtype} pixels", path=path, mend="export it again with 8 or 16 bits")
    ordered: Any = cv2.cvtColor(image, order[image.shape[2]]) if image.ndim == 3 else image
    return ordered


def read_unchanged(path: Path) -> NDArray[np.generic]:
    """(H, W) or (H, W, C) with the values and the order of channels that the file has.

    Raises:
        DriveError: missing, unreadable or cut short.
    """
    return _decode(_content_of(path), path, cv2.IMREAD_UNCHANGED)


def read_metadata(path: Path) -> Metadata:
    """What the file of a picture holds beside its pixels.

    Raises:
        DriveError: missing, or cannot be read.
    """
    return metadata_of(_content_of(path))


def read_image(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB.

    Args:
        size: see :func:`decode_image`.
    Raises:
        DriveError: missing, unreadable, cut short, or of another size.
    """
    return as_bytes(read_levels(path, size))


def read_levels(path: Path, size: tuple[int, int] | None = None) -> Levels:
    """The same with all bits that it has."""
    return decode_levels(_content_of(path), path, size)


def read_label_image(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(H, W) uint8 labels or masks; a mask stored in colour is read by its first channel.

    Args:
        size: see :func:`decode_image`.
    Raises:
        DriveError: missing, unreadable, of another size, or not 8 bits deep.
    """
    image = _decode(_content_of(path), path, cv2.IMREAD_UNCHANGED, size)
    if image.ndim == 3:
        image = image[..., 0]
    if image.dtype != np.uint8:
        raise DriveError(f"has {image.dtype} pixels", path=path, mend="labels and masks are 8-bit PNGs")
    return np.ascontiguousarray(image)


@dataclass(frozen=True, eq=False)
class Values:
    """What a picture holds, before anybody says what its numbers mean.

    Attributes:
        pixels: (H, W), or (H, W, C) with C of 3 RGB or 4 RGBA; 8 or 16 bits. Of a picture with a palette the numbers of that.
        palette: (N, 3) uint8 RGB; None where there is none.
        lossy: its format changes numbers a little, as JPEG does.
    """

    pixels: NDArray[np.uint8] | NDArray[np.uint16]
    palette: NDArray[np.uint8] | None = None
    lossy: bool = False


def read_values(path: Path, size: tuple[int, int] | None = None) -> Values:
    """The numbers of a label picture or a mask as its file has them.

    Args:
        size: see :func:`decode_image`.
    Raises:
        DriveError: missing, unreadable, of another size, or with other numbers than whole ones of 8 or 16 bits.
    """
    content = _content_of(path)
    lossy = is_lossy(content)
    _header(content, path)
    own = indexed(content)
    if own is not None:
        numbers = _decode(own.grey, path, cv2.IMREAD_UNCHANGED, size)
        if numbers.ndim == 2 and numbers.dtype == np.uint8:
            numbers = numbers // own.step
            if int(numbers.max(initial=0)) < len(own.palette):
                return Values(np.asarray(numbers, np.uint8), own.palette)
    image = _decode(content, path, cv2.IMREAD_UNCHANGED, size)
    if image.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise DriveError(f"has {image.dtype} pixels", path=path, mend="labels and masks are pictures of 8 or 16 bits")
    order = {3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGBA}
    pixels: Any = cv2.cvtColor(image, order[image.shape[2]]) if image.ndim == 3 else image
    return Values(pixels, None, lossy)


def read_instance_image(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint16]:
    """(H, W) uint16 instance ids.

    Args:
        size: see :func:`decode_image`.
    Raises:
        DriveError: missing, unreadable, of another size, or of several channels.
    """
    image = _decode(_content_of(path), path, cv2.IMREAD_UNCHANGED, size)
    if image.ndim != 2 or image.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise DriveError("Not an image of one channel", path=path, mend="instances are 16-bit PNGs of ids")
    return image.astype(np.uint16)
