"""Crops: parts of an image around its holes, for an inpainter that takes images of limited size."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from unveil_core.base.types import Mask

__all__ = ["Crop", "crops"]

CONTEXT_SHARE = 16
"""A hole needs known pixels on each side, as many as the limit divided by this (64 of 1024), or it counts as too large for a crop
at full resolution."""
CONTEXT_LEAST_PX = 64
"""Least width of the surroundings shown around a hole where the size is free, pixels; as much as the hole is wide, if that is
more."""


@dataclass(frozen=True, eq=False)
class Crop:
    """A part of an image.

    Attributes:
        part: rows and columns of the image.
        size: (height, width) at which it is to be shown; smaller than the part only if its hole is larger than the limit.
        pixels: bool, of the part's shape: the pixels to take from this crop.
    """

    part: tuple[slice, slice]
    size: tuple[int, int]
    pixels: Mask


def crops(mask: Mask, limit: tuple[int, int], *, whole: bool) -> Iterator[Crop]:
    """Crops that each hold as many holes as fit with their surroundings; a hole larger than the limit gets one that is reduced.

    Args:
        mask: (H, W) to be filled; limit: (height, width) of what can be shown.
        whole: parts are of exactly the limit's size, or the image's where that is less; else only as large as the
            surroundings of their holes ask for.
    """
    for pixels, box in _groups(mask, limit):
        spans = box[:2], box[2:]
        if any(_extent(*span, most, total) > most for span, most, total in zip(spans, limit, mask.shape, strict=True)):
            yield _reduced(pixels, box, limit)
            continue
        sizes = [
            most if whole else min(most, (high - low) + 2 * max(CONTEXT_LEAST_PX, high - low))
            for (low, high), most in zip(spans, limit, strict=True)
        ]
        rows = _along(*spans[0], sizes[0], mask.shape[0])
        columns = _along(*spans[1], sizes[1], mask.shape[1])
        yield Crop((rows, columns), (_length(rows), _length(columns)), pixels[rows, columns])


def _extent(low: int, high: int, limit: int, total: int) -> int:
    """How long a hole is with the surroundings that it needs and has."""
    context = limit // CONTEXT_SHARE
    return min(high + context, total) - max(low - context, 0)


def _along(low: int, high: int, size: int, total: int) -> slice:
    """A span of ``size``, or all there is, with the hole in its middle where the image's border lets it."""
    size = min(size, total)
    start = min(max((low + high - size) // 2, 0), total - size)
    return slice(start, start + size)


def _length(span: slice) -> int:
    return int(span.stop - span.start)


def _reduced(pixels: Mask, box: tuple[int, int, int, int], limit: tuple[int, int]) -> Crop:
    """A part with half as much again as its hole on each axis, shown so small that it fits."""
    spans = [1.5 * (box[1] - box[0]), 1.5 * (box[3] - box[2])]
    scale = max(spans[0] / limit[0], spans[1] / limit[1], 1.0)
    rows = _along(box[0], box[1], math.ceil(limit[0] * scale), pixels.shape[0])
    columns = _along(box[2], box[3], math.ceil(limit[1] * scale), pixels.shape[1])
    height, width = (
        max(1, min(most, round(_length(span) / scale))) for span, most in zip((rows, columns), limit, strict=True)
    )
    return Crop((rows, columns), (height, width), pixels[rows, columns])


def _groups(mask: Mask, limit: tuple[int, int]) -> Iterator[tuple[Mask, tuple[int, int, int, int]]]:
    """Holes that fit into one crop together: their pixels (H, W), and their box (top, bottom, left, right)."""
    count, component, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    x, y, w, h = (stats[:, k].astype(np.int64) for k in range(4))
    boxes = np.stack([y, y + h, x, x + w], axis=1)
    waiting = np.arange(1, count)
    while len(waiting):
        box = boxes[waiting[0]]
        # Many specks: only those that a crop from this hole could reach are looked at one by one.
        low, high = np.minimum(boxes[waiting], box), np.maximum(boxes[waiting], box)
        near = (high[:, 1] - low[:, 0] <= limit[0]) & (high[:, 3] - low[:, 2] <= limit[1])
        taken = [0]
        for k in np.nonzero(near)[0]:
            other = boxes[waiting[k]]
            union = np.array(
                [min(box[0], other[0]), max(box[1], other[1]), min(box[2], other[2]), max(box[3], other[3])]
            )
            if _extent(union[0], union[1], limit[0], mask.shape[0]) <= limit[0] and (
                _extent(union[2], union[3], limit[1], mask.shape[1]) <= limit[1]
            ):
                box = union
                taken.append(k)  # type: ignore[arg-type]
        top, bottom, left, right = (int(v) for v in box)
        yield np.isin(component, waiting[taken]), (top, bottom, left, right)
        waiting = np.delete(waiting, taken)
