"""Photographs of a drive as files hold them: whether in a file of their own or in a dataset's table, 8 or 16 bits, RGB or not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.output.copies import copied_or_linked
from unveil_core.base.pictures.decoding import decode_levels, read_image, read_image_as_it_is, read_levels
from unveil_core.base.pictures.headers import PNG_BYTES, png_start
from unveil_core.base.pictures.levels import as_bytes
from unveil_core.base.plates.files import read_plate
from unveil_core.base.types import Float32, Levels
from unveil_core.drives.drive import Footage, Frame

__all__ = ["is_plain", "levels", "photograph", "photograph_levels", "read_footage", "seen_footage", "store_photograph"]

RGB = 2
"""PNG's number for colour without a palette or transparency."""


def photograph(frame: Frame) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of a frame as read, before import; see :func:`photograph_levels`."""
    return as_bytes(photograph_levels(frame))


def photograph_levels(frame: Frame) -> Levels:
    """The same with all bits that it has.

    Raises:
        DriveError: missing, unreadable, cut short, or not of its camera's size.
    """
    size = (frame.camera.width, frame.camera.height)
    if frame.plate is not None:
        encoded = frame.plate.encoded(read_plate(frame.image_path, size).values)
        return np.clip(np.nan_to_num(encoded), 0, 1) * np.float32(255)
    if frame.image_bytes is not None:
        return decode_levels(frame.image_bytes(), frame.image_path, size)
    return read_levels(frame.image_path, size)


def levels(picture: Float32) -> NDArray[np.uint8]:
    """A picture of a plate with 8 bits; what is no number, as renders have it, is black."""
    return np.round(np.clip(np.nan_to_num(picture), 0, 1) * 255).astype(np.uint8)


def store_photograph(frame: Frame, destination: Path) -> None:
    """Put the photograph's file, byte for byte, at ``destination``."""
    if frame.image_bytes is not None:
        write_bytes_atomic(destination, frame.image_bytes(), like=frame.image_path)
    else:
        copied_or_linked(frame.image_path, destination)


def is_plain(frame: Frame) -> bool:
    """Whether the file is what a delivered PNG of 8-bit RGB can hold: a JPEG, or such a PNG."""
    if frame.image_path.suffix.lower() in (".jpg", ".jpeg"):
        return True
    if frame.image_bytes is not None:
        header = frame.image_bytes()[:PNG_BYTES]
    else:
        with open_file(frame.image_path) as stream:
            header = stream.read(PNG_BYTES)
    found = png_start(header)
    return found is not None and found[2:] == (8, RGB)


def seen_footage(footage: Footage) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of the footage.

    Raises:
        DriveError: missing, unreadable or cut short.
    """
    return read_image(footage.path) if footage.plate is None else levels(read_footage(footage))


def read_footage(footage: Footage) -> NDArray[Any]:
    """The footage as its file has it: (H, W), (H, W, 3) RGB or (H, W, 4) RGBA, 8 or 16 bits; of a plate (H, W, 3) float32 as the
    scene sees it, which is not cut off at 0 and 1.

    Raises:
        DriveError: missing, unreadable or cut short.
    """
    if footage.plate is not None:
        size = (footage.camera.width, footage.camera.height)
        return np.nan_to_num(footage.plate.encoded(read_plate(footage.path, size).values))
    return read_image_as_it_is(footage.path)
