"""What a lateral offset of the street looks like: paint, kerb and walk continue along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.inpaint.shade import luminance

__all__ = ["lateral_profile"]

Float32 = NDArray[np.float32]


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
    # Offsets with nothing in the window take the nearest window that has something, then the nearest offset.
    index = np.arange(len(centres))
    for column in range(columns):
        known = np.isfinite(levels[:, column])
        if known.any():
            nearest = index[known][np.abs(index[:, None] - index[known][None]).argmin(axis=1)]
            medians[:, column], levels[:, column] = medians[nearest, column], levels[nearest, column]
    known_columns = np.flatnonzero(np.isfinite(levels[0]))
    if len(known_columns):
        take = known_columns[np.abs(np.arange(columns)[:, None] - known_columns[None]).argmin(axis=1)]
        medians, levels = medians[:, take], levels[:, take]
    else:
        medians[:], levels[:] = 0.5, 0.5
    position = np.arange(rows) / hop
    lower = np.clip(position.astype(int), 0, len(centres) - 2)
    blend = (position - lower).astype(np.float32)
    median = medians[lower] * (1 - blend)[:, None, None] + medians[lower + 1] * blend[:, None, None]
    level = levels[lower] * (1 - blend)[:, None] + levels[lower + 1] * blend[:, None]
    return median, level
