"""Compares the rows of a facade with the rows that lie some steps farther along it."""

# mypy: ignore-errors
from __future__ import annotations

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT

__all__ = ["compare_rows"]


@njit(**EXACT)
def compare_rows(
    start, stop, at, shifts, color, wall, context, known, held, worth, different, total, count, lacks, wall_gap
):
    """What each of some rows has in common with each shifted one.

    Args:
        at: (R,) the rows, of which ``start`` up to ``stop`` are compared; shifts: (D,).
        color: (A, B, 3); wall: (A, 3) the plaster's colour.
        context: (A, B) weights of what a row is compared by; known: (A, B) texels; held: (A, B) those of them
            that may be copied; worth: (A, B) of the wanted texels, 0 of others.
        different: squared difference at which differences are clipped.
        total, count: (R, D) filled with the weighted clipped differences and their weights, 0 where there is no such row.
        lacks: (R, D) filled with what the wanted texels are worth that the other row does not have.
        wall_gap: (R, D) filled with the clipped squared difference of the plaster, 0 where there is no such row.
    """
    rows, columns = context.shape
    for r in range(start, stop):
        i = at[r]
        for k in range(len(shifts)):
            j = i + shifts[k]
            inside = 0 <= j < rows
            difference, weight, missing = 0.0, 0.0, 0.0
            gap = 0.0
            if inside:
                red, green, blue = wall[i, 0] - wall[j, 0], wall[i, 1] - wall[j, 1], wall[i, 2] - wall[j, 2]
                gap = min(red * red + green * green + blue * blue, different)
            for c in range(columns):
                if not (inside and held[j, c]):
                    missing += worth[i, c]
                share = context[i, c]
                if share == 0 or not inside or not known[j, c]:
                    continue
                x, y, z = (
                    color[i, c, 0] - color[j, c, 0],
                    color[i, c, 1] - color[j, c, 1],
                    color[i, c, 2] - color[j, c, 2],
                )
                # Alike are panes that have the same colour, and plaster that differs as plaster does between the two places.
                u, v, w = x - red, y - green, z - blue
                least = min(x * x + y * y + z * z, u * u + v * v + w * w)
                difference += share * min(least, different)
                weight += share
            total[r, k], count[r, k], lacks[r, k], wall_gap[r, k] = difference, weight, missing, gap
