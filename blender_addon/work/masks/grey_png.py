# SPDX-License-Identifier: GPL-3.0-or-later
"""A grey picture as a PNG, without a library. No bpy here."""

from __future__ import annotations

import struct
import zlib

import numpy as np

__all__ = ["grey_png"]


def grey_png(picture: np.ndarray) -> bytes:
    """The PNG of a picture (H, W) uint8."""
    height, width = picture.shape
    rows = np.zeros((height, width + 1), np.uint8)  # a byte before each row: no filter
    rows[:, 1:] = picture
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in parts)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
