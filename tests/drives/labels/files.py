"""Label pictures as people's programs write them, made of one small street."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.base.pictures.files import chunk
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.labels.orders import ORDERS, order_targets
from unveil_core.semantics.classes import COLORS

__all__ = ["WIDTH_HEIGHT", "as_order", "as_palette", "in_colours", "saved", "street_labels"]

WIDTH_HEIGHT = 64, 48


def street_labels(i: int = 0) -> NDArray[np.uint8]:
    """(48, 64) trainIds of frame i: sky, houses, trees, road, sidewalk, a pole, a car, a person and some void."""
    label = np.full((48, 64), CITYSCAPES.index("building"), np.uint8)
    label[:12] = CITYSCAPES.index("sky")
    label[8:24, 40:] = CITYSCAPES.index("vegetation")
    label[26:] = CITYSCAPES.index("road")
    label[26:34, :10] = CITYSCAPES.index("sidewalk")
    label[10:28, 12:14] = CITYSCAPES.index("pole")
    label[20:32, 16 + i : 30 + i] = CITYSCAPES.index("car")
    label[22:32, 50:53] = CITYSCAPES.index("person")
    label[46:, 20:44] = 255
    return label


def as_order(label: NDArray[np.uint8], order: str, void: int = 255) -> NDArray[np.uint8]:
    """The same in the numbers of another data set."""
    count = ORDERS[order][0]
    targets = order_targets(order)
    table = np.full(256, void, np.uint8)
    for k in range(len(CITYSCAPES)):
        own = np.flatnonzero(targets == k)
        if len(own):
            table[k] = own[0]
    assert count <= 256
    return table[label]


def in_colours(label: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) RGB, void black."""
    colours = np.zeros((256, 3), np.uint8)
    colours[: len(COLORS)] = COLORS
    return colours[label]


def as_palette(numbers: NDArray[np.uint8], palette: NDArray[np.uint8], bits: int = 8) -> bytes:
    """A PNG with a palette (N, 3) RGB."""
    height, width = numbers.shape
    per = 8 // bits
    rows = np.zeros((height, -(-width // per) * per), np.uint8)
    rows[:, :width] = numbers
    packed = np.zeros((height, rows.shape[1] // per), np.uint8)
    for k in range(per):
        packed |= rows[:, k::per] << (8 - bits * (k + 1))
    data = b"".join(b"\0" + row.tobytes() for row in packed)
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 3, 0, 0, 0)),
            chunk(b"PLTE", palette.astype(np.uint8).tobytes()),
            chunk(b"IDAT", zlib.compress(data)),
            chunk(b"IEND", b""),
        )
    )


def saved(path: Path, picture: NDArray[np.generic] | bytes) -> Path:
    """Write a picture, RGB or RGBA where it has colours, or the bytes of a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(picture, bytes):
        path.write_bytes(picture)
        return path
    if picture.ndim == 3:
        order = cv2.COLOR_RGBA2BGRA if picture.shape[2] == 4 else cv2.COLOR_RGB2BGR
        picture = cv2.cvtColor(picture, order)
    options = [cv2.IMWRITE_JPEG_QUALITY, 92] if path.suffix == ".jpg" else []
    assert cv2.imwrite(str(path), picture, options)
    return path
