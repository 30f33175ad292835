"""Names for the array types in signatures. Shapes are given in docstrings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Float32", "Float64", "Labels", "Levels", "Mask", "Picture"]

Mask = NDArray[np.bool_]
"""True where something holds, mostly (H, W)."""
Picture = NDArray[np.uint8]
"""8-bit sRGB, (H, W, 3)."""
Levels = NDArray[Any]
"""sRGB in levels of 255, (H, W, 3): of 8 bits, or float32 that is neither rounded nor cut off at 0 and 255."""
Labels = NDArray[np.int64]
"""Compact labels or instance ids, (H, W) or (N,)."""
Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
