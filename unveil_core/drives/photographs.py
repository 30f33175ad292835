"""Photographs of a drive as files hold them: whether in a file of their own or in a dataset's table, 8 or 16 bits, RGB or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.output.copies import copied_or_linked
from unveil_core.base.pictures.decoding import decode_image, read_image, read_image_as_it_is
from unveil_core.base.pictures.headers import PNG_BYTES, png_start
from unveil_core.drives.drive import Footage, Frame

__all__ = ["is_plain", "photograph", "read_footage", "store_photograph"]

RGB = 2
"""PNG's number for colour without a palette or transparency."""


def photograph(frame: Frame) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of a frame as read, before import.

    Raises:
        DriveError: missing, unreadable, cut short, or not of its camera's size.
    """
    size = (frame.camera.width, frame.camera.height)
    if frame.image_bytes is not None:
        return decode_image(frame.image_bytes(), frame.image_path, size)
    return read_image(frame.image_path, size)


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


def read_footage(footage: Footage) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The footage as its file has it: (H, W), (H, W, 3) RGB or (H, W, 4) RGBA, 8 or 16 bits.

    Raises:
        DriveError: missing, unreadable or cut short.
    """
    return read_image_as_it_is(footage.path)
