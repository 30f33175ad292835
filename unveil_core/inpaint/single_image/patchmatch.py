"""PatchMatch: fills a hole of one image with patches of its own surroundings.

Coarse to fine: every patch that touches the hole looks for its nearest patch among the known ones (Barnes et al. 2009,
*PatchMatch*: propagation and random search), then every hole pixel takes what the patches over it say (Wexler et al.
2007, *Space-Time Completion of Video*: weighted votes), again and again until both agree. Random numbers come from a
hash of pixel position and iteration, so the same image always gives the same result.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT
from unveil_core.base.pictures.levels import rounded_like
from unveil_core.base.types import Float32, Levels, Mask

__all__ = ["patch_fill"]

RADIUS = 3
"""Half the side of a patch, pixels: patches are 7x7."""
ROUNDS_COARSE, ROUNDS_FINE, SEARCHES = 8, 2, 3
"""Rounds of matching and voting at the coarsest and at the finest level, and sweeps of propagation and random search in each."""
SMALLEST_PX = 24
"""No level is smaller than this many pixels on its shorter side."""
LEAST_SPREAD = np.float32(4.0)
"""Least spread of the votes, squared levels of 255: matches that differ by less than two levels are as good as exact."""


def patch_fill(image: Levels, mask: Mask, *, row_cost: float = 0.0) -> Levels | None:
    """Fill ``mask``.

    Args:
        image: (H, W, 3) levels of 255; mask: (H, W) bool, True = to fill.
        row_cost: of a patch from another row, squared levels of 255 for each squared pixel of distance.
    Returns:
        (H, W, 3) likewise, the image itself outside of ``mask``; None where no known patch exists to take from.
    """
    if not mask.any():
        return image.copy()
    if not _sources(mask).any():
        return None
    levels = _pyramid(image.astype(np.float32), mask)
    match: NDArray[np.int32] | None = None
    picture = levels[-1][0]
    for depth in range(len(levels) - 1, -1, -1):
        known, hole = levels[depth]
        sources = _sources(hole)
        targets = cv2.dilate(hole.astype(np.uint8), np.ones((2 * RADIUS + 1,) * 2, np.uint8)).astype(bool)
        if match is None:
            start = cv2.inpaint(np.clip(known, 0, 255).astype(np.uint8), hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)
            picture = np.where(hole[..., None], start, known).astype(np.float32)
            match = np.full((*hole.shape, 2), -1, np.int32)
        else:
            match = _finer(match, hole.shape)
            # Where the coarser level knew a match its colours are taken from this level's pixels at once.
            wide = cv2.resize(picture, hole.shape[::-1], interpolation=cv2.INTER_LINEAR)
            picture = np.where(hole[..., None], wide, known).astype(np.float32)
        share = depth / max(1, len(levels) - 1)
        rounds = round(ROUNDS_FINE + share * (ROUNDS_COARSE - ROUNDS_FINE))
        cost = np.empty(hole.shape, np.float32)
        certainty, places = _certainty(hole), np.argwhere(sources)
        for turn in range(rounds):
            per_row = np.float32(row_cost * 4.0**depth)
            _match(picture, sources, places, targets, match, cost, per_row, SEARCHES, turn + 100 * depth)
            # A third of the patches decide; the final vote is sharper still, so that texture is not averaged away.
            spread = max(
                np.float32(np.percentile(cost[targets].astype(float), 25 if turn + 1 == rounds else 50)), LEAST_SPREAD
            )
            picture = _vote(picture, hole, targets, match, cost, certainty, spread)
    return np.where(mask[..., None], rounded_like(picture, image), image)


def _sources(hole: Mask) -> Mask:
    """Centres of patches that are known in full."""
    size = 2 * RADIUS + 1
    inside = np.zeros(hole.shape, np.uint8)
    inside[RADIUS:-RADIUS, RADIUS:-RADIUS] = 1
    touched = cv2.dilate(hole.astype(np.uint8), np.ones((size, size), np.uint8))
    return (inside > 0) & (touched == 0)


def _pyramid(image: Float32, mask: Mask) -> list[tuple[Float32, Mask]]:
    """(known colours, hole) per level, finest first: halved until a patch spans the hole or nothing is left to take."""
    levels = [(image, mask)]
    while True:
        known, hole = levels[-1]
        thickness = cv2.distanceTransform(np.pad(hole, 1).astype(np.uint8), cv2.DIST_L2, 3).max()
        size = (hole.shape[1] // 2, hole.shape[0] // 2)
        if thickness <= RADIUS or min(size) < SMALLEST_PX:
            return levels
        weight = cv2.resize((~hole).astype(np.float32), size, interpolation=cv2.INTER_AREA)
        color = cv2.resize(known * ~hole[..., None], size, interpolation=cv2.INTER_AREA)
        coarse = weight < 0.5
        if not _sources(coarse).any():
            return levels
        levels.append((color / np.maximum(weight, 1e-6)[..., None] * ~coarse[..., None], coarse))


def _certainty(hole: Mask) -> Float32:
    """How much a patch at a place is to be believed: known ones fully, less and less towards the middle of the hole."""
    depth = cv2.distanceTransform(np.pad(hole, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    fall: Float32 = np.power(np.float32(1.3), -depth).astype(np.float32)
    return fall


def _finer(match: NDArray[np.int32], shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Matches of a level with twice the size: the same neighbours, twice as far."""
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
    up = np.minimum(rows // 2, match.shape[0] - 1), np.minimum(columns // 2, match.shape[1] - 1)
    coarse = match[up]
    fine = 2 * coarse + np.stack([rows % 2, columns % 2], axis=-1).astype(np.int32)
    return np.where(coarse >= 0, fine, -1).astype(np.int32)


@njit(**EXACT)
def _noise(a, b, c):  # type: ignore[no-untyped-def]
    """A number in [0, 1) from three integers."""
    x = (
        (np.uint32(a) * np.uint32(73856093))
        ^ (np.uint32(b) * np.uint32(19349663))
        ^ (np.uint32(c) * np.uint32(83492791))
    )
    x ^= x >> np.uint32(16)
    x = np.uint32(x * np.uint32(0x45D9F3B))
    x ^= x >> np.uint32(16)
    x = np.uint32(x * np.uint32(0x45D9F3B))
    x ^= x >> np.uint32(16)
    return np.float64(x) / 4294967296.0


@njit(**EXACT)
def _distance(picture, y, x, v, u, limit):  # type: ignore[no-untyped-def]
    """Mean squared difference of two patches; the target's may reach over the border, where nothing counts."""
    rows, columns = picture.shape[0], picture.shape[1]
    y0, y1 = max(-RADIUS, -y), min(RADIUS, rows - 1 - y)
    x0, x1 = max(-RADIUS, -x), min(RADIUS, columns - 1 - x)
    count = np.float32((y1 - y0 + 1) * (x1 - x0 + 1))
    bound, total = limit * count, np.float32(0)
    for dy in range(y0, y1 + 1):
        for dx in range(x0, x1 + 1):
            for k in range(3):
                d = picture[y + dy, x + dx, k] - picture[v + dy, u + dx, k]
                total += d * d
        if total > bound:
            break
    return total / count


@njit(**EXACT)
def _try(picture, sources, match, cost, row_cost, y, x, v, u):  # type: ignore[no-untyped-def]
    if v < 0 or u < 0 or v >= sources.shape[0] or u >= sources.shape[1] or not sources[v, u]:
        return
    level = row_cost * np.float32((v - y) * (v - y))
    if level >= cost[y, x]:
        return
    d = level + _distance(picture, y, x, v, u, cost[y, x] - level)
    if d < cost[y, x]:
        cost[y, x] = d
        match[y, x, 0], match[y, x, 1] = v, u


@njit(**EXACT)
def _match(picture, sources, places, targets, match, cost, row_cost, searches, turn):  # type: ignore[no-untyped-def]
    """Improve the nearest known patch of every target patch in place; ``cost`` gets the mean squared differences, and what the
    rows between cost."""
    rows, columns = targets.shape
    for y in range(rows):
        for x in range(columns):
            if not targets[y, x]:
                continue
            v, u = match[y, x, 0], match[y, x, 1]
            if v < 0 or v >= rows or u >= columns or not sources[v, u]:
                pick = int(_noise(y, x, turn) * len(places))
                v, u = places[pick, 0], places[pick, 1]
                match[y, x, 0], match[y, x, 1] = v, u
            level = row_cost * np.float32((v - y) * (v - y))
            cost[y, x] = level + _distance(picture, y, x, v, u, np.float32(1e30))
    reach = max(rows, columns)
    for sweep in range(searches):
        step = 1 if sweep % 2 == 0 else -1
        for i in range(rows):
            y = i if step > 0 else rows - 1 - i
            for j in range(columns):
                x = j if step > 0 else columns - 1 - j
                if not targets[y, x]:
                    continue
                if 0 <= y - step < rows and targets[y - step, x]:
                    v, u = match[y - step, x, 0] + step, match[y - step, x, 1]
                    _try(picture, sources, match, cost, row_cost, y, x, v, u)
                if 0 <= x - step < columns and targets[y, x - step]:
                    v, u = match[y, x - step, 0], match[y, x - step, 1] + step
                    _try(picture, sources, match, cost, row_cost, y, x, v, u)
                radius = reach
                draw = 0
                while radius >= 1:
                    at = (turn * 16 + sweep) * 32 + draw
                    v = match[y, x, 0] + int(np.floor((2 * _noise(y, x, at) - 1) * radius + 0.5))
                    u = match[y, x, 1] + int(np.floor((2 * _noise(x, y, at + 7919) - 1) * radius + 0.5))
                    _try(picture, sources, match, cost, row_cost, y, x, v, u)
                    radius //= 2
                    draw += 1


@njit(**EXACT)
def _vote(picture, hole, targets, match, cost, certainty, spread):  # type: ignore[no-untyped-def]
    """Every hole pixel becomes the weighted mean of what the patches over it would put there."""
    rows, columns = hole.shape
    result = picture.copy()
    for y in range(rows):
        for x in range(columns):
            if not hole[y, x]:
                continue
            total, r, g, b = 0.0, 0.0, 0.0, 0.0
            for dy in range(-RADIUS, RADIUS + 1):
                for dx in range(-RADIUS, RADIUS + 1):
                    cy, cx = y - dy, x - dx
                    if cy < 0 or cx < 0 or cy >= rows or cx >= columns or not targets[cy, cx]:
                        continue
                    w = certainty[cy, cx] * np.exp(-cost[cy, cx] / spread) + 1e-12
                    w *= np.exp(-(dy * dy + dx * dx) / 4.5)
                    v, u = match[cy, cx, 0] + dy, match[cy, cx, 1] + dx
                    total += w
                    r += w * picture[v, u, 0]
                    g += w * picture[v, u, 1]
                    b += w * picture[v, u, 2]
            result[y, x, 0], result[y, x, 1], result[y, x, 2] = r / total, g / total, b / total
    return result
