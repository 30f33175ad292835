"""Lines on the ground: edges of paint and kerbs that the clean frame has to show where the true street has them.

An edge is where the gradient of the smoothed luminance is largest across it (Canny, *A computational approach to edge
detection*, 1986). Its strength is the height, in levels of 255, of the sharp step that would give this gradient, so that one
threshold holds for every size of image. A line is a long edge. What is drawn on the ground beside paint and kerbs counts, too:
covers, wide cracks and edges of shadows that stay.

Found lines have to run the same way and to be brighter on the same side: the two edges of a stripe that moved by its own width
are not found in each other's place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.geometry.images import border_px, scale_from_384

__all__ = ["Edges", "LineMatch", "find_edges", "match_lines", "reach_px"]

SMOOTHING_PX = 1.0
"""Standard deviation of the smoothing, pixels at 384 px: grain of 2 levels leaves strengths of 1 level."""
LINE_LEVELS = 16.0
"""Least strength of a line's pixels. Of the asphalt of the parked street, cracks and grain, 99 % of the pixels have less than 16;
kerbs and edges of shadows have 18 to 62, paint 48 and more (5th and 95th percentile)."""
START_LEVELS = 24.0
"""Some pixel of a line is at least so strong, or it is texture that happens to be connected: 99.9 % of that asphalt has less than
21."""
EDGE_LEVELS = 10.0
"""Least strength of the edges among which lines are looked for: so much below a line's that grain cannot decide. 95 %
of that asphalt has 10 or less."""
KEPT_CONTRAST = 0.5
"""A line is found with this share of its true strength and more: with less it is blurred or faded until the eye misses it. A
sharp edge blurred by 2 pixels at 384 px has less: the true parked street so blurred has a recall of 40 %, by 1 pixel 97 %, by 3
pixels, which is still 25 dB, 4 %."""
LENGTH_PX = 12
"""Shortest line, pixels between its ends at 384 px: shorter ones are dashes near the horizon and texture."""
REACH_PX = 2
"""How far from its place a line is found, pixels at 384 px; wider in images above 800, see ``border_px``."""
MOST_TURN = math.radians(30.0)
"""How much a found line may be turned."""
STEPS = 16
"""Steps of a level in the whole numbers that OpenCV's Canny takes."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a picture.

    Attributes:
        edge: (H, W) pixels on an edge of at least ``EDGE_LEVELS``; line: (H, W) pixels on a line.
        right, down: (H, W) float32 gradient of the smoothed luminance, as strength in levels; strength: its length.
    """

    edge: Mask
    line: Mask
    right: Float32
    down: Float32
    strength: Float32


@dataclass(frozen=True, eq=False)
class LineMatch:
    """Lines of a clean frame against those of the true street, all (H, W).

    Attributes:
        found, missed: pixels of true lines with and without one of ours within reach.
        right, false: pixels of our lines with and without a true edge within reach.
    """

    found: Mask
    missed: Mask
    right: Mask
    false: Mask


def reach_px(width: int) -> int:
    """How far from its place a line is found, pixels, in an image so wide."""
    return border_px(width, REACH_PX)


def find_edges(picture: Picture) -> Edges:
    """Edges and lines of a picture (H, W, 3) uint8."""
    width = picture.shape[1]
    sigma = SMOOTHING_PX * reach_px(width) / REACH_PX
    smooth = cv2.GaussianBlur(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), sigma)
    # A step of one level has a slope of 1 / (sigma sqrt(2 pi)) once smoothed; Sobel's weights sum up to 8.
    scale = sigma * math.sqrt(2 * math.pi) / 8
    right, down = (cv2.Sobel(smooth, cv2.CV_32F, *axes, scale=scale) for axes in ((1, 0), (0, 1)))
    across, along = ((gradient * STEPS).astype(np.int16) for gradient in (right, down))
    edge, weak = (
        cv2.Canny(across, along, least * STEPS, least * STEPS, L2gradient=True) for least in (EDGE_LEVELS, LINE_LEVELS)
    )
    strength = cv2.magnitude(right, down)
    start = (weak > 0) & (strength >= START_LEVELS)
    return Edges(edge > 0, _long(weak, start, LENGTH_PX * scale_from_384(width)), right, down, strength)


def _long(edges: NDArray[np.uint8], start: Mask, shortest: float) -> Mask:
    """Connected edges (H, W) with an extent of at least ``shortest`` pixels and a pixel in ``start``."""
    _, number, boxes, _ = cv2.connectedComponentsWithStats(edges, connectivity=8)
    good = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) >= shortest
    begun = np.zeros(len(good), dtype=bool)
    begun[number[start]] = True
    good &= begun
    good[0] = False
    line: Mask = good[number]
    return line


def match_lines(truth: Edges, ours: Edges, where: Mask) -> LineMatch:
    """Compare the lines of two pictures of one size.

    Args:
        where: (H, W) pixels whose lines are compared; what they are found in may lie beside it.
    """
    true_line, our_line = truth.line & where, ours.line & where
    found = _found(true_line, truth, ours, KEPT_CONTRAST)
    right = _found(our_line, ours, truth, 0.0)
    return LineMatch(found, true_line & ~found, right, our_line & ~right)


def _found(pixels: Mask, one: Edges, other: Edges, kept: float) -> Mask:
    """Pixels of ``one`` (H, W) with an edge of ``other`` in reach that runs the same way with this share of the strength."""
    height, width = pixels.shape
    reach = reach_px(width)
    rows, columns = np.nonzero(pixels)
    right, down, strength = (plane[rows, columns] for plane in (one.right, one.down, one.strength))
    found = np.zeros(len(rows), dtype=bool)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            if math.hypot(i, j) > reach:
                continue
            at = np.clip(rows + i, 0, height - 1) * width + np.clip(columns + j, 0, width - 1)
            near = np.flatnonzero(other.edge.ravel()[at] & ~found)
            at, length = at[near], strength[near]
            there = other.strength.ravel()[at]
            along = right[near] * other.right.ravel()[at] + down[near] * other.down.ravel()[at]
            found[near] = (along >= math.cos(MOST_TURN) * length * there) & (there >= kept * length)
    out = np.zeros_like(pixels)
    out[rows[found], columns[found]] = True
    return out
