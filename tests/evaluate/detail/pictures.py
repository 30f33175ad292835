"""Pictures of an asphalt road with painted lines, as the tests of lines and residue need them."""

from __future__ import annotations

import cv2
import numpy as np

WIDTH, HEIGHT = 384, 256
ASPHALT, PAINT = 100, 200


def road(*, scale: int = 1, shift: float = 0.0, width: float = 4.0, paint: int = PAINT) -> np.ndarray:
    """(256, 384, 3) uint8 asphalt with a slanted line of this ``width``, ``shift`` pixels aside, antialiased, enlarged."""
    row, column = np.mgrid[: HEIGHT * scale, : WIDTH * scale] / scale
    # The line runs from the foot of the picture to the right of its middle, 20 degrees off the vertical.
    slant = np.radians(20.0)
    away = (column - 150 - shift / np.cos(slant)) * np.cos(slant) + (row - HEIGHT) * np.sin(slant)
    share = np.clip((width / 2 - np.abs(away)) * scale + 0.5, 0, 1)
    grey = ASPHALT + share * (paint - ASPHALT)
    return np.repeat(np.round(grey).astype(np.uint8)[..., None], 3, axis=2)


def grained(picture: np.ndarray, levels: float, seed: int = 0) -> np.ndarray:
    """With Gaussian grain of so many levels in each channel."""
    noise = np.random.default_rng(seed).normal(0, levels, picture.shape)
    return np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)


def blurred(picture: np.ndarray, sigma: float) -> np.ndarray:
    """With a Gaussian blur."""
    return cv2.GaussianBlur(picture, (0, 0), sigma)
