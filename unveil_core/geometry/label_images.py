"""Label images at another size.

Labels cannot be averaged, and a sample of every n-th pixel depends on which one is taken: OpenCV's ``INTER_NEAREST`` takes
the upper left one of each block, which shifts labels by up to half a pixel of the smaller image against a photograph that is
reduced by area. Here each pixel takes the label that covers most of it.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT, in_parallel

__all__ = ["resize_labels"]

ROWS = 16
"""Rows of the result that a thread takes at a time."""


def resize_labels(labels: NDArray[np.integer], size: tuple[int, int]) -> NDArray[np.integer]:
    """A label image at another size, each pixel with the label that covers most of its area.

    Where two labels cover as much, every other pixel takes the one and the rest the other, as on a chessboard: so an edge
    through the middle of a row of pixels stays there on average.

    Args:
        labels: (H, W), any integers; size: width and height of the result.
    Returns:
        (height, width) of the same type.
    """
    width, height = size
    if labels.shape == (height, width):
        return labels
    if labels.ndim != 2 or not np.issubdtype(labels.dtype, np.integer):
        raise ValueError(f"labels must be integers (H, W), not {labels.dtype} {labels.shape}")
    found = np.empty((height, width), dtype=labels.dtype)
    in_parallel(_most_of_each, height, ROWS, np.ascontiguousarray(labels), found)
    return found


@njit(**EXACT)
def _most_of_each(start, stop, labels, found):
    rows, columns = labels.shape
    height, width = found.shape
    # Lengths in parts of which a source pixel has as many as the result has pixels, and the other way round: whole numbers.
    most = (rows // height + 2) * (columns // width + 2)
    names = np.empty(most, np.int64)
    areas = np.empty(most, np.int64)
    for y in range(start, stop):
        top, bottom = y * rows, (y + 1) * rows
        r0, r1 = top // height, (bottom - 1) // height
        for x in range(width):
            left, right = x * columns, (x + 1) * columns
            c0, c1 = left // width, (right - 1) // width
            count = 0
            for r in range(r0, r1 + 1):
                tall = min(bottom, (r + 1) * height) - max(top, r * height)
                for c in range(c0, c1 + 1):
                    area = tall * (min(right, (c + 1) * width) - max(left, c * width))
                    name = np.int64(labels[r, c])
                    k = 0
                    while k < count and names[k] != name:
                        k += 1
                    if k == count:
                        names[k], areas[k] = name, 0
                        count += 1
                    areas[k] += area
            best = 0
            for k in range(1, count):
                higher = (names[k] > names[best]) == ((x + y) % 2 == 1)
                if areas[k] > areas[best] or (areas[k] == areas[best] and higher):
                    best = k
            found[y, x] = names[best]
