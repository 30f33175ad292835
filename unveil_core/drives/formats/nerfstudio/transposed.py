"""Matrices of poses that lie on their side: programs that keep columns together write the place of a camera as the last row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["turned_upright"]


def turned_upright(entries: list[Any]) -> tuple[list[Any], str | None]:
    """The frames of a transforms.json with matrices as they are meant, and what a user should know of it.

    A rigid matrix ends in the row (0, 0, 0, 1). Where all end in such a column in its stead, and some have a place in their last
    row, nothing else can be meant; other matrices are let alone.
    """
    found = [_matrix(e.get("transform_matrix")) if isinstance(e, dict) else None for e in entries]
    matrices = [m for m in found if m is not None]
    if len(matrices) < len(entries) or not all((m[:, 3] == (0, 0, 0, 1)).all() for m in matrices):
        return entries, None
    if not any(m[3, :3].any() for m in matrices):
        return entries, None
    turned = [{**e, "transform_matrix": m.T.tolist()} for e, m in zip(entries, matrices, strict=True)]
    return turned, "matrices of poses have the place of the camera in their last row: they are transposed"


def _matrix(value: object) -> NDArray[np.float64] | None:
    try:
        matrix = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return matrix if matrix.shape == (4, 4) and bool(np.isfinite(matrix).all()) else None
