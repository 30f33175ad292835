"""Some of many, from the first to the last."""

from __future__ import annotations

import numpy as np

__all__ = ["evenly"]


def evenly(count: int, most: int) -> list[int]:
    """Indices of as many of ``count`` things as there are to be at most, ascending."""
    return [int(i) for i in np.linspace(0, count - 1, min(count, most)).round()]
