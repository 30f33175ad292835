"""Levels of 255, as they are counted everywhere, in pictures of 8 bits and of more: in memory floats, on disk 16 bits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Levels

__all__ = ["as_bytes", "as_words", "colors_of", "levels_of", "rounded_like"]

WORDS = 257
"""Steps of 16 bits in a level of 255: white is white in both."""


def as_bytes(levels: NDArray[Any]) -> NDArray[np.uint8]:
    """Levels with 8 bits, rounded and cut off at 0 and 255."""
    return levels if levels.dtype == np.uint8 else np.clip(np.round(levels), 0, 255).astype(np.uint8)


def as_words(levels: NDArray[Any]) -> NDArray[np.uint16]:
    """Levels with 16 bits, likewise."""
    return np.clip(np.round(levels.astype(np.float32) * WORDS), 0, 255 * WORDS).astype(np.uint16)


def levels_of(pixels: NDArray[Any]) -> Levels:
    """Levels of a file's picture of 8 or 16 bits: of 8 the picture itself, of 16 float32."""
    return pixels if pixels.dtype == np.uint8 else pixels.astype(np.float32) / np.float32(WORDS)


def colors_of(levels: Levels) -> Float32:
    """Colours, white 1, of levels."""
    return levels.astype(np.float32) / np.float32(255)


def rounded_like(levels: Float32, picture: Levels) -> Levels:
    """Levels in the precision of a picture: of 8 bits only where that has no more."""
    return as_bytes(levels) if picture.dtype == np.uint8 else levels
