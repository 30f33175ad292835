"""Image quilting along one axis: a hole in a texture is filled with patches of the same columns from other rows.

After Efros and Freeman, *Image quilting for texture synthesis and transfer* (2001); what lies at one lateral offset of a street
looks alike all along it, so patches move along the street only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.types import Float32, Mask

__all__ = ["quilt"]

STRIDE = 2
"""Every second texel and every second shift is compared, which takes an eighth of the time."""
UNKNOWN_COST = 0.01
"""Mean squared difference, colours in [0, 1], of a source with nothing around the patch to compare it with. Chosen on the two
sample streets."""
GAP_COST = 0.02
"""Added to a source's mean squared difference if it lacks all of what is asked for; in proportion where it lacks less. Chosen on
the two sample streets."""
DISTANCE_COST = 1e-6
"""Added per row of distance: of sources that are equally good the nearest is taken."""
MOST_LACKING = 4
"""A source that lacks more than one in so many of the texels that are asked for is no source."""


class _Texture(NamedTuple):
    """See :func:`quilt`."""

    detail: Float32
    valid: Mask
    hole: Mask


class _Canvas(NamedTuple):
    """What has been laid down so far.

    Attributes:
        filled: (A, B, 3) the texture with the hole as far as it is filled; known: (A, B) where that holds something.
        total: (A, B, 3) weighted sum of the patches; weight: (A, B) sum of the weights.
    """

    filled: Float32
    known: Mask
    total: Float32
    weight: Float32


def quilt(detail: Float32, valid: Mask, hole: Mask, *, patch: int, search: int) -> Float32:
    """Detail (A, B, 3) for the ``hole``, zero elsewhere.

    Args:
        detail: (A, B, 3) texture, zero on average; valid: (A, B) where it is known; hole: (A, B) where it is wanted.
        patch: side of a patch, texels; search: how many rows away its source may lie.
    """
    canvas = _Canvas(detail.copy(), valid.copy(), np.zeros_like(detail), np.zeros(hole.shape, dtype=np.float32))
    if hole.any():
        _quilt(_Texture(detail, valid, hole), canvas, patch, search)
    return canvas.total


@njit(cache=True)
def _quilt(texture, canvas, patch, search):  # type: ignore[no-untyped-def]
    """Overlapping patches in raster order; each takes the rows that best meet what already lies in and around it, and overlaps
    are blended with a tent. In the end the canvas's ``total`` is the mean."""
    hole, total, weight = texture.hole, canvas.total, canvas.weight
    rows, columns = hole.shape
    step = max(1, patch * 2 // 3)
    for r0 in range(0, rows, step):
        for c0 in range(0, columns, step):
            r1, c1 = min(rows, r0 + patch), min(columns, c0 + patch)
            need = 0
            for r in range(r0, r1):
                for c in range(c0, c1):
                    if hole[r, c] and weight[r, c] == 0:
                        need += 1
            if need == 0:
                continue
            best_cost, best_shift = 1e30, 0
            for shift in range(-search, search + 1, STRIDE):
                if -patch < shift < patch or r0 + shift < 0 or r1 + shift > rows:
                    continue
                cost = _cost(texture, canvas, (r0, r1, c0, c1), shift, patch // 4)
                if cost < best_cost:
                    best_cost, best_shift = cost, shift
            if best_cost < 1e30:
                _lay(texture, canvas, (r0, r1, c0, c1), best_shift, patch)
    for r in range(rows):
        for c in range(columns):
            if weight[r, c] > 0:
                for k in range(3):
                    total[r, c, k] /= weight[r, c]


@njit(cache=True)
def _cost(texture, canvas, box, shift, ring):  # type: ignore[no-untyped-def]
    """Matching cost of the source rows ``shift`` away against the known texels in and around a patch; 1e30 if too few are valid."""
    detail, valid, hole = texture.detail, texture.valid, texture.hole
    r0, r1, c0, c1 = box
    rows, columns = hole.shape
    lacking = 0
    wanted = 0
    for r in range(r0, r1, STRIDE):
        for c in range(c0, c1, STRIDE):
            if hole[r, c]:
                wanted += 1
                if not valid[r + shift, c]:
                    lacking += 1
    if wanted == 0 or lacking * MOST_LACKING > wanted:
        return 1e30
    cost, count = 0.0, 0
    for r in range(max(0, r0 - ring), min(rows, r1 + ring), STRIDE):
        if r + shift < 0 or r + shift >= rows:
            continue
        for c in range(max(0, c0 - ring), min(columns, c1 + ring), STRIDE):
            if canvas.known[r, c] and valid[r + shift, c]:
                for k in range(3):
                    d = canvas.filled[r, c, k] - detail[r + shift, c, k]
                    cost += d * d
                count += 1
    mean = cost / count if count > 0 else UNKNOWN_COST
    return mean + GAP_COST * lacking / wanted + DISTANCE_COST * abs(shift)


@njit(cache=True)
def _lay(texture, canvas, box, shift, patch):  # type: ignore[no-untyped-def]
    """Blend the rows ``shift`` away into a patch."""
    detail, valid, hole = texture.detail, texture.valid, texture.hole
    total, weight = canvas.total, canvas.weight
    r0, r1, c0, c1 = box
    for r in range(r0, r1):
        for c in range(c0, c1):
            if hole[r, c] and valid[r + shift, c]:
                tr = min(r - r0 + 1, r1 - r) / patch
                tc = min(c - c0 + 1, c1 - c) / patch
                w = np.float32(max(0.01, min(tr, tc)))
                for k in range(3):
                    total[r, c, k] += w * detail[r + shift, c, k]
                weight[r, c] += w
                for k in range(3):
                    canvas.filled[r, c, k] = total[r, c, k] / weight[r, c]
                canvas.known[r, c] = True
