"""The colour of each lateral offset of the street, as a running median along it: paint, kerb and sidewalk are constant along s."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32
from unveil_core.geometry.images import luminance

__all__ = ["lateral_profile", "nearest_known"]

LIT_QUANTILE = 0.7
"""Quantile of luma that stands for an offset's lit level: above the median, so that an offset that lies in shadow for up to 70 %
of the window still has the level of the sun. Chosen on the two sample streets."""
LEAST_SHARE = 1 / 4
"""Share of a window's samples that must be usable for its median to count: a few texels between two parked cars say less than
many farther along. Chosen on the two sample streets."""
LEAST_SAMPLES = 8
"""Fewest samples of a median, however short the window is."""
RARE_SAMPLES = 16
"""Fewest samples along the whole street of an offset that no window knows, for these to be its colour: 2 m."""
SAMPLE_STEP = 3
"""Every third row of a window is sampled: neighbouring 4 cm texels come from the same pixels."""
ALONG_LIMIT = 2.4
"""Half windows: beyond this distance along s a value of the same offset is used only if no neighbouring offset within
``ASIDE_LIMIT`` is known. Chosen on the two sample streets."""
ASIDE_LIMIT = 0.08
"""Half windows (0.4 m for one of 5 m): see ``ALONG_LIMIT``. Less than a kerb's distance from anything of another colour."""

BROAD = 0.2
"""Half windows (1 m for one of 5 m): width of the known street beside offsets that are known nowhere whose middle they get, several
times that of a line."""


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
        part = slice(max(0, centre - window), min(rows, centre + window + 1), SAMPLE_STEP)
        least = max(LEAST_SAMPLES, int(2 * window // SAMPLE_STEP * LEAST_SHARE))
        count = usable[part].sum(axis=0)
        enough = count >= least
        if enough.any():
            medians[k, enough] = _quantile(everything[part][:, enough], count[enough, None], 0.5)
            levels[k, enough] = _quantile(all_luma[part][:, enough], count[enough], LIT_QUANTILE)
    # What was seen of an offset only here and there tells more of it than its neighbours do.
    count = usable[::SAMPLE_STEP].sum(axis=0)
    rare = ~np.isfinite(levels).any(axis=0) & (count >= RARE_SAMPLES)
    if rare.any():
        medians[:, rare] = _quantile(everything[::SAMPLE_STEP, rare], count[rare, None], 0.5)
        levels[:, rare] = _quantile(all_luma[::SAMPLE_STEP, rare], count[rare], LIT_QUANTILE)
    known = np.isfinite(levels)
    if known.any():
        medians, levels = _completed(medians, levels, known, hop=hop, window=window)
    else:
        medians[:], levels[:] = 0.5, 0.5
    position = np.arange(rows) / hop
    lower = np.clip(position.astype(int), 0, len(centres) - 2)
    blend = (position - lower).astype(np.float32)
    median = medians[lower] * (1 - blend)[:, None, None] + medians[lower + 1] * blend[:, None, None]
    level = levels[lower] * (1 - blend)[:, None] + levels[lower + 1] * blend[:, None]
    return median, level


def _quantile(values: Float32, count: NDArray[np.int64], share: float) -> NDArray[np.float64]:
    """Linear quantile (B, ...) of what is no NaN in (A, B, ...), of which there are ``count`` (B, ...) > 0.

    ``np.nanquantile`` gives the same, but works column by column as soon as there is a NaN.
    """
    count = np.broadcast_to(count, values.shape[1:])
    place = share * (count - 1)
    below = np.floor(place).astype(np.int64)
    ranked = np.sort(values, axis=0)  # NaNs come last
    low, high = (
        np.take_along_axis(ranked, np.minimum(b, count - 1)[None], axis=0)[0].astype(np.float64)
        for b in (below, below + 1)
    )
    quantile: NDArray[np.float64] = low + (high - low) * (place - below)
    return quantile


def _completed(
    medians: Float32, levels: Float32, known: NDArray[np.bool_], *, hop: int, window: int
) -> tuple[Float32, Float32]:
    """Medians (K, B, 3) and levels (K, B) filled where they are not ``known``.

    From the same offset farther along, or from a neighbouring one (see ``ALONG_LIMIT``), which is better at the foot of walls.
    """
    index, column = np.indices(known.shape)
    along, beside = nearest_known(known), nearest_known(known.T).T
    far = (along < 0) | (np.abs(along - index) * hop > ALONG_LIMIT * window)
    close = (beside >= 0) & (np.abs(beside - column) <= ASIDE_LIMIT * window)
    aside = far & close
    row, offset = np.where(aside | (along < 0), index, along), np.where(aside, beside, column)
    somewhere = known.any(axis=0)
    of_offset = np.full(medians.shape[1:], np.nan, np.float32), np.full(levels.shape[1:], np.nan, np.float32)
    of_offset[0][somewhere] = np.nanmedian(medians[:, somewhere], axis=0)
    of_offset[1][somewhere] = np.nanmedian(levels[:, somewhere], axis=0)
    distant = far & ~close & (along >= 0)
    medians = np.where(distant[..., None], of_offset[0][None], medians[row, offset]).astype(np.float32)
    levels = np.where(distant, of_offset[1][None], levels[row, offset]).astype(np.float32)
    return _to_unknown_offsets(medians, levels, somewhere, beside=max(1, round(BROAD * window)))  # type: ignore[arg-type]


def _to_unknown_offsets(
    medians: Float32, levels: Float32, somewhere: NDArray[np.bool_], *, beside: int
) -> tuple[Float32, Float32]:
    """Medians (K, B, 3) and levels (K, B) of offsets that are known nowhere, from the ``beside`` known ones next to them: the
    middle of these, for the next one of all may be a line."""
    there = np.flatnonzero(somewhere)
    medians, levels = medians.copy(), levels.copy()
    unknown = np.flatnonzero(~somewhere)
    nearest = nearest_known(somewhere[:, None])[unknown, 0]
    for column in np.unique(nearest):
        place = int(np.searchsorted(there, column))
        # The side that the unknown ones lie on tells which known ones are next to them.
        left, right = there[place : place + beside], there[max(0, place + 1 - beside) : place + 1]
        for some, side in ((left, unknown < column), (right, unknown > column)):
            own = unknown[side & (nearest == column)]
            if len(own):
                medians[:, own] = np.median(medians[:, some], axis=1, keepdims=True)
                levels[:, own] = np.median(levels[:, some], axis=1, keepdims=True)
    return medians, levels


def nearest_known(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(K, B) per column the index of the nearest known row, -1 where the column has none."""
    rows = len(known)
    index = np.arange(rows)[:, None]
    before = np.maximum.accumulate(np.where(known, index, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, index, 2 * rows)[::-1], axis=0)[::-1]
    back = np.where(before >= 0, index - before, 4 * rows)
    ahead = np.where(after < rows, after - index, 4 * rows)
    found = np.where(back <= ahead, before, after)
    return np.where(np.minimum(back, ahead) >= 4 * rows, -1, found).astype(np.int64)
