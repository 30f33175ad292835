"""Where invented facades were copied from, so that delivery finds the footage that shows them in full detail; on disk
``inpaint/facades.npz`` of a workspace, arrays only.

By number of a piece: ``N.copied`` (A, B) bool, ``N.rows`` (A, 6) float32 (offset, offset there, shift, and the ratio of the three
channels) and ``N.place`` (2,) float64 (arc length of the first row and side of a texel, metres).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import NO_ARCHIVE, write_atomic
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.ground.street import Ground

__all__ = ["FacadeCopies", "copied_from", "read_copies", "save_copies"]

LARGEST_BYTES = 1 << 32
"""Of all arrays together: a hundred kilometres of street."""
NAMES = ("copied", "rows", "place")
KINDS = [np.dtype(bool), np.dtype(np.float32), np.dtype(np.float64)]
BEFORE_M = 0.6
"""How far from its plane something belongs to the facade, metres: sills, door frames and the error of rendered depth."""


@dataclass(frozen=True, eq=False)
class FacadeCopies:
    """A piece of a facade, and where what nobody saw of it was copied from.

    Attributes:
        copied: (A, B) texels that were copied, rows along the street, columns upwards from the ground.
        rows: (A, 6) lateral offset of each row, that of the row that it was copied from, how far along the street that one lies,
            metres, and by how much brighter the copy is, by channel.
        place: (2,) arc length of the first row's centre and side of a texel, metres.
    """

    copied: Mask
    rows: Float32
    place: Float64

    @property
    def s(self) -> Float64:
        """(A,) arc lengths of the rows' centres."""
        along: Float64 = self.place[0] + self.place[1] * np.arange(len(self.rows))
        return along

    def part(self, own: Mask) -> FacadeCopies | None:
        """The rows from the first to the last of some (A,); None for none."""
        at = np.flatnonzero(own & self.copied.any(axis=1))
        if not len(at):
            return None
        first, end = int(at[0]), int(at[-1]) + 1
        place = np.array([self.place[0] + first * self.place[1], self.place[1]])
        return FacadeCopies(self.copied[first:end] & own[first:end, None], self.rows[first:end], place)

    def origin(self, street: Float64, height: Float64) -> tuple[NDArray[np.int64], Float64, Float32]:
        """Which of some places were copied, and from where.

        Args:
            street: (N, 3) street coordinates; height: (N,) over the ground, metres.
        Returns:
            their indices (M,), arc length and lateral offset of what they were copied from (M, 2), and by how much brighter they
            are (M, 3).
        """
        s_start, texel = self.place
        row = np.round((street[:, 0] - s_start) / texel)
        column = np.floor(height / texel)
        rows, columns = self.copied.shape
        some = np.flatnonzero((row >= 0) & (row < rows) & (column >= 0) & (column < columns))
        at, up = row[some].astype(np.int64), column[some].astype(np.int64)
        aside = street[some, 1] - self.rows[at, 0]
        good = self.copied[at, up] & (np.abs(aside) < BEFORE_M)
        some, at, aside = some[good], at[good], aside[good]
        there = np.stack([street[some, 0] + self.rows[at, 2], self.rows[at, 1] + aside], axis=1)
        return some, there, self.rows[at, 3:]


def copied_from(
    ground: Ground, pieces: Sequence[FacadeCopies]
) -> Callable[[Float64], tuple[NDArray[np.int64], Float64, Float32]] | None:
    """Tells of world points (N, 3) which were copied: their indices (M,), the world points that they were copied from (M, 3), and
    by how much brighter they are (M, 3). None where nothing was copied.

    Args:
        ground: of the street along which the pieces stand.
    """
    if not pieces:
        return None
    ends = np.array([piece.s[[0, -1]] for piece in pieces])

    def look(points: Float64) -> tuple[NDArray[np.int64], Float64, Float32]:
        street = ground.path.to_street(points)
        height = ground.over(street)
        # Of a long drive most pieces are elsewhere; one is asked in any case, so that there is an answer.
        near = (ends[:, 1] >= street[:, 0].min()) & (ends[:, 0] <= street[:, 0].max())
        asked = np.flatnonzero(near) if near.any() else [0]
        found = [pieces[k].origin(street, height) for k in asked]  # type: ignore[index]
        some, there, ratio = (np.concatenate(parts) for parts in zip(*found, strict=True))
        up = ground.height_at(*there.T) + height[some]
        return some, ground.path.to_world(np.column_stack([there, up])), ratio

    return look


def save_copies(pieces: Sequence[FacadeCopies], path: Path) -> None:
    """Write the pieces, of none an archive without arrays."""
    arrays = {f"{k}.{name}": getattr(piece, name) for k, piece in enumerate(pieces) for name in NAMES}
    write_atomic(path, lambda stream: np.savez_compressed(stream, **arrays))  # type: ignore[arg-type]


def read_copies(path: Path) -> list[FacadeCopies]:
    """Read what :func:`save_copies` wrote.

    Raises:
        WorkspaceError: it cannot be read.
    """
    try:
        with open_npz(path, None, LARGEST_BYTES) as data:
            found = [FacadeCopies(*(data[f"{k}.{name}"] for name in NAMES)) for k in range(len(data) // len(NAMES))]
        for piece in found:
            if [piece.copied.dtype, piece.rows.dtype, piece.place.dtype] != KINDS:
                raise ValueError("arrays of other types")
            if piece.copied.ndim != 2 or piece.rows.shape != (len(piece.copied), 6) or piece.place.shape != (2,):
                raise ValueError("arrays of other shapes")
            if not (np.isfinite(piece.place).all() and piece.place[1] > 0 and np.isfinite(piece.rows).all()):
                raise ValueError("numbers that are none")
    except (*NO_ARCHIVE, KeyError) as error:
        raise WorkspaceError(f"tells no copies: {error}", path=path, mend="run `unveil inpaint` again") from error
    return found
