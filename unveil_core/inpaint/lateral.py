"""What a lateral offset of the street looks like: paint, kerb and walk continue along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.inpaint.shade import luminance

__all__ = ["lateral_profile"]

Float32 = NDArray[np.float32]
LIKE = (0.6, 1.5)
"""How much darker or brighter than farther along an offset may be taken to be."""


def lateral_profile(color: Float32, usable: NDArray[np.bool_], *, window: int, hop: int) -> tuple[Float32, Float32]:
    """Median colour and upper luma level per lateral offset, in a window that slides along the street.

    Args:
        color: (A, B, 3) of the chart; usable: (A, B) texels that count.
        window, hop: half window and step, in texels.
    Returns:
        median (A, B, 3) and the 70th percentile of luma (A, B), both interpolated along the street.
    """
    rows, columns = usable.shape
    centres = np.arange(0, rows + hop, hop)
    medians = np.full((len(centres), columns, 3), np.nan, dtype=np.float32)
    levels = np.full((len(centres), columns), np.nan, dtype=np.float32)
    luma = luminance(color)
    everything = np.where(usable[..., None], color, np.nan)
    all_luma = np.where(usable, luma, np.nan)
    for k, centre in enumerate(centres):
        part = slice(max(0, centre - window), min(rows, centre + window + 1), 3)
        # A few texels between two cars say less than many farther along.
        least = max(8, 2 * window // 3 // 4)
        enough = usable[part].sum(axis=0) >= least
        if enough.any():
            medians[k, enough] = np.nanmedian(everything[part][:, enough], axis=0)
            levels[k, enough] = np.nanpercentile(all_luma[part][:, enough], 70, axis=0)
    known = np.isfinite(levels)
    if known.any():
        medians, levels = _completed(medians, levels, known)
    else:
        medians[:], levels[:] = 0.5, 0.5
    position = np.arange(rows) / hop
    lower = np.clip(position.astype(int), 0, len(centres) - 2)
    blend = (position - lower).astype(np.float32)
    median = medians[lower] * (1 - blend)[:, None, None] + medians[lower + 1] * blend[:, None, None]
    level = levels[lower] * (1 - blend)[:, None] + levels[lower + 1] * blend[:, None]
    return median, level


def _completed(medians: Float32, levels: Float32, known: NDArray[np.bool_]) -> tuple[Float32, Float32]:
    """Medians (K, B, 3) and levels (K, B) where they are not ``known``: what the street hides here it shows farther along.

    It may be brighter there, or another pavement: what is taken over is how it differs from the nearest offset that is
    known at both places.
    """
    index, column = np.indices(known.shape)
    along, beside = _nearest(known), _nearest(known.T).T
    has_along, has_beside = along >= 0, beside >= 0
    full_medians, full_levels = medians[np.maximum(along, 0), column], levels[np.maximum(along, 0), column]
    there = levels[np.maximum(along, 0), np.maximum(beside, 0)]
    both = ~known & has_along & has_beside & np.isfinite(there)
    here = levels[index, np.maximum(beside, 0)]
    ratio = np.where(both, here / np.maximum(there, 0.02), 1.0).clip(*LIKE).astype(np.float32)
    full_medians, full_levels = full_medians * ratio[..., None], full_levels * ratio
    # Offsets that are known nowhere take the nearest one that is.
    somewhere = np.flatnonzero(has_along[0])
    take = somewhere[np.abs(np.arange(known.shape[1])[:, None] - somewhere[None]).argmin(axis=1)]
    return full_medians[:, take], full_levels[:, take]


def _nearest(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(K, B) per column the index of the nearest known row, -1 where the column has none."""
    rows = len(known)
    index = np.arange(rows)[:, None]
    before = np.maximum.accumulate(np.where(known, index, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, index, 2 * rows)[::-1], axis=0)[::-1]
    back = np.where(before >= 0, index - before, 4 * rows)
    ahead = np.where(after < rows, after - index, 4 * rows)
    found = np.where(back <= ahead, before, after)
    return np.where(np.minimum(back, ahead) >= 4 * rows, -1, found).astype(np.int64)
