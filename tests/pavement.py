"""Pictures with a known filling, for tests of everything that fills holes."""

from __future__ import annotations

import numpy as np


def tiles(height: int = 96, width: int = 128) -> np.ndarray:
    """A periodic pavement: the true filling is known."""
    y, x = np.mgrid[:height, :width]
    joint = (y % 16 < 2) | ((x + 8 * (y // 16 % 2)) % 16 < 2)
    return np.where(joint[..., None], (50, 45, 40), (190, 150, 120)).astype(np.uint8)


def box(shape: tuple[int, ...], y0: int, y1: int, x0: int, x1: int) -> np.ndarray:
    """A rectangle's mask."""
    mask = np.zeros(shape[:2], dtype=bool)
    mask[y0:y1, x0:x1] = True
    return mask


def worn_tiles() -> tuple[np.ndarray, np.ndarray]:
    """The pavement with noise, and a mask of two holes."""
    image = np.clip(tiles().astype(int) + np.random.default_rng(3).integers(-20, 20, tiles().shape), 0, 255)
    return image.astype(np.uint8), box(image.shape, 30, 45, 40, 58) | box(image.shape, 70, 78, 100, 120)
