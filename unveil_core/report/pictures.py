"""Images for the page: which frames, how large, as data URIs; region overlays."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Picture
from unveil_core.geometry.label_images import resize_labels
from unveil_core.remove.regions import OBSERVED, SEEN_ELSEWHERE, UNOBSERVED

__all__ = [
    "REGION_COLORS",
    "REGION_NAMES",
    "data_uri",
    "fitted",
    "jpeg_uri",
    "page_size",
    "pick",
    "png_uri",
    "region_overlay_uri",
]


REGION_COLORS: dict[int, tuple[int, int, int]] = {
    OBSERVED: (86, 140, 245),
    SEEN_ELSEWHERE: (48, 176, 130),
    UNOBSERVED: (240, 140, 50),
}
"""sRGB; told apart also by people who see no difference between red and green."""
REGION_NAMES: dict[int, str] = {
    OBSERVED: "border, seen by the frame itself",
    SEEN_ELSEWHERE: "seen from other frames",
    UNOBSERVED: "never seen",
}

MOST_FRAMES = 32
PIXELS_OF_ALL_FRAMES = 3_400_000
SMALLEST_SIDE = 320
FRAME_BYTES = 11_000_000
"""Of the page's text for the pictures of all frames: less than half of a page of 25 MB. Only noise comes near it."""
LEAST_QUALITY = 34
"""Of JPEG: noise at this quality has two bits a pixel."""


def pick(count: int, most: int = MOST_FRAMES) -> list[int]:
    """Indices of at most ``most`` of ``count`` frames, evenly spaced, first and last included."""
    if count <= most:
        return list(range(count))
    return [round(i * (count - 1) / (most - 1)) for i in range(most)]


def page_size(width: int, height: int, count: int) -> tuple[int, int]:
    """Width and height at which ``count`` images of one kind stay light enough for one page; never enlarged."""
    scale = min(1.0, math.sqrt(PIXELS_OF_ALL_FRAMES / max(1, count * width * height)))
    scale = min(1.0, max(scale, SMALLEST_SIDE / max(width, height)))
    return max(1, round(width * scale)), max(1, round(height * scale))


def fitted(image: Picture, size: tuple[int, int], *, labels: bool = False) -> Picture:
    """An image at (width, height), by area; labels by what covers most of a pixel."""
    if (image.shape[1], image.shape[0]) == size:
        return image
    if labels:
        return resize_labels(image, size).astype(np.uint8)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)


def jpeg_uri(image: Picture, quality: int = 82, most: int | None = None) -> str:
    """A ``data:image/jpeg`` URI of an RGB image.

    Args:
        quality: of JPEG.
        most: characters that it may have; the quality is lowered until it fits, at the least to :data:`LEAST_QUALITY`.
    """
    while True:
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
        uri = _uri(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options, "image/jpeg")
        if most is None or len(uri) <= most or quality <= LEAST_QUALITY:
            return uri
        quality = max(LEAST_QUALITY, quality - 12)


def png_uri(image: Picture) -> str:
    """A ``data:image/png`` URI of an RGB or RGBA image."""
    order = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return _uri(".png", cv2.cvtColor(image, order), [cv2.IMWRITE_PNG_COMPRESSION, 9], "image/png")


def region_overlay_uri(regions: Picture) -> str:
    """A region map (H, W) of 0 to 3 as a transparent overlay."""
    overlay = np.zeros((*regions.shape, 4), dtype=np.uint8)
    for region, color in REGION_COLORS.items():
        overlay[regions == region] = (*color, 165)
    return png_uri(overlay)


def _uri(suffix: str, image: Sequence[int] | NDArray[np.generic], options: list[int], kind: str) -> str:
    done, encoded = cv2.imencode(suffix, np.asarray(image), options)
    if not done:
        raise ValueError(f"cannot encode a picture as {suffix}")
    return data_uri(kind, encoded.tobytes())


def data_uri(kind: str, content: bytes) -> str:
    """A ``data:`` URI of some bytes of a media type."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
