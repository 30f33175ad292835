"""A chart's luma in strips along the street, in which markings are looked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask

__all__ = ["strip_means"]


def strip_means(luma: Float32, known: Mask, width: int) -> tuple[Float64, NDArray[np.int64]]:
    """Mean luma (A, S) of what is known of each strip of so many columns in a row, 0 where nothing is, and of how many (A, S)."""
    count = luma.shape[1] // width
    cut = np.s_[:, : count * width]
    seen = known[cut].reshape(len(luma), count, width)
    many = seen.sum(axis=2)
    return np.where(seen, luma[cut].reshape(seen.shape), 0).sum(axis=2) / np.maximum(many, 1), many
