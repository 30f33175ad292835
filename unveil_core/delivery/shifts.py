"""Where invented ground may take its grain from: a piece of seen ground of the same kind, a constant shift away.

The filled chart has texels of centimetres, and averages what many views saw. What is finer, as the grain of asphalt and the joints
of paving, is taken from the footage itself, by one shift for each block of the street: it stays in place from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask

__all__ = ["GroundShifts", "find_shifts"]

CELL_M = 0.2
"""Cells in which ground is compared, metres."""
BLOCK_M = 1.0
"""Side of the blocks that share a shift, metres: wider than what grain repeats over, narrower than a lane."""
WINDOW_M = 2.0
"""Side of the neighbourhood that has to fit, metres: neighbouring blocks then mostly agree."""
LATERAL_M, ALONG_M = 8.0, 12.0
"""Farthest shifts, metres."""
COST_ACROSS, COST_ALONG = 0.02, 0.04
"""What a metre of shift costs, as a share of fitting cells: along the street resolution changes, across it hardly."""
LEAST_SHARE = 0.4
"""Of the cells around a block that must have seen ground of the same kind at the other end."""


@dataclass(frozen=True, eq=False)
class GroundShifts:
    """Shifts by place.

    Attributes:
        s_start, t_start: street coordinates of the first block's corner; block: side, metres.
        shift: (A, B, 2) metres along and across; NaN where nothing fits.
        made: (A', B') bool cells whose ground was invented or relit; cell: side of these, metres.
    """

    s_start: float
    t_start: float
    block: float
    shift: Float64
    made: Mask
    cell: float

    def at(self, street: Float64) -> Float64:
        """(N, 2) shift of places (N, 2+) in street coordinates; NaN where there is none."""
        row, column, inside = self._index(street, self.block, self.shift.shape[:2])
        return np.where(inside[:, None], self.shift[row, column], np.nan)

    def is_made(self, street: Float64) -> Mask:
        """(N,) whether the ground at places (N, 2+) was invented or relit."""
        row, column, inside = self._index(street, self.cell, self.made.shape)
        return inside & self.made[row, column]

    def _index(
        self, street: Float64, size: float, shape: tuple[int, ...]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Mask]:
        row = np.floor((street[:, 0] - self.s_start) / size).astype(np.int64)
        column = np.floor((street[:, 1] - self.t_start) / size).astype(np.int64)
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        return np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1), inside


def _cells(texels: NDArray[np.generic], side: int) -> NDArray[np.float32]:
    """(A', B') mean of texels (A, B) in cells of ``side`` texels."""
    rows, columns = texels.shape[0] // side, texels.shape[1] // side
    part = texels[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return part.mean(axis=(1, 3)).astype(np.float32)


def _shifted(cells: NDArray[np.float32], down: int, right: int) -> NDArray[np.float32]:
    """(A, B) what lies ``down`` and ``right`` of each cell; 0 beyond the border."""
    rows, columns = cells.shape
    place = np.array([[1, 0, -right], [0, 1, -down]], dtype=np.float64)
    return cv2.warpAffine(cells, place, (columns, rows), flags=cv2.INTER_NEAREST)


def find_shifts(
    observed: Mask, made: Mask, kinds: NDArray[np.int16], *, s_start: float, t_start: float, texel: float
) -> GroundShifts:
    """Choose a shift for each block with invented ground.

    Args:
        observed: (A, B) texels that frames show as they are; made: (A, B) invented or relit ones.
        kinds: (A, B) labels of the texels.
        s_start, t_start: street coordinates of the first texel; texel: its side, metres.
    """
    side = max(1, round(CELL_M / texel))
    cell = side * texel
    seen = {k: _cells(observed & (kinds == k), side) for k in np.unique(kinds[made])} if made.any() else {}
    wanted = {k: _cells(made & (kinds == k), side) for k in seen}
    made_cells = _cells(made, side) > 0
    block = max(1, round(BLOCK_M / cell))
    shape = made_cells.shape
    blocks = (-(-shape[0] // block), -(-shape[1] // block))
    best = np.zeros(blocks, dtype=np.float32)
    shift = np.full((*blocks, 2), np.nan)
    window = (round(WINDOW_M / cell) | 1,) * 2
    total = sum((cv2.boxFilter(w, -1, window, normalize=False) for w in wanted.values()), np.zeros(shape, np.float32))
    middle = (slice(block // 2, None, block), slice(block // 2, None, block))
    for down, right in _candidates(cell):
        fit = np.zeros(shape, dtype=np.float32)
        for k, cells in wanted.items():
            fit += cells * _shifted(seen[k], down, right)
        share = cv2.boxFilter(fit, -1, window, normalize=False) / np.maximum(total, 1e-6)
        score = share - np.float32(cell * (COST_ALONG * abs(down) + COST_ACROSS * abs(right)))
        part, fits = score[middle], share[middle]
        part = np.pad(part, [(0, n - m) for n, m in zip(blocks, part.shape, strict=True)])
        fits = np.pad(fits, [(0, n - m) for n, m in zip(blocks, fits.shape, strict=True)])
        better = (part > best) & (fits > LEAST_SHARE)
        best[better] = part[better]
        shift[better] = (down * cell, right * cell)
    corner = (s_start - 0.5 * texel, t_start - 0.5 * texel)
    return GroundShifts(corner[0], corner[1], block * cell, shift, made_cells, cell)


def _candidates(cell: float) -> Sequence[tuple[int, int]]:
    """Shifts in cells, those across first: of equals the first is taken."""
    across = [
        j for j in range(-round(LATERAL_M / cell), round(LATERAL_M / cell) + 1, 2) if abs(j) * cell >= BLOCK_M / 2
    ]
    along = [i for i in range(-round(ALONG_M / cell), round(ALONG_M / cell) + 1, 4) if abs(i) * cell >= BLOCK_M]
    both = [(i, j) for i in along[::4] for j in across[::4]]
    return [(0, j) for j in across] + [(i, 0) for i in along] + both
