"""Connected clusters of points: exactly those that a list of all near pairs would give, without that list.

The number of pairs within a radius grows with the square of the density. Here points go into cells so small that all points of
one cell are within the radius of each other: a cell is joined as a whole, and of two cells it only matters whether *some* pair is
near (the grid of Gunawan, *A faster algorithm for DBSCAN*, 2013). That is found by halving both where they come closest. Cells
are a sorted list, not a dense grid: neither how far the points reach nor where a stray one lies changes what is stored.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.types import Float64

__all__ = ["connected_points"]

Index = NDArray[np.int64]
SHRINK = 1 - 1e-6
"""The side of a cell as a share of what its diagonal would allow, so that rounding puts no two points farther apart than the radius
into one; enough for coordinates of up to 1e9 radii."""
FEW_PAIRS = 64
"""So many pairs of points are compared one by one; of more, a half is looked at at a time. Makes little difference: a street of
five million points takes 2.3 to 2.7 s with 4 to 1024."""
FINE = 1e-9
"""Parts of two cells smaller than this share of the radius are one place: what is not decided there is rounding."""
DEEPEST = 256
"""Pairs of parts of two cells that may wait at a time. Each halving leaves one waiting, six halve all sides of both parts in space,
and 30 times that go from the radius down to ``FINE`` of it: 180."""


def connected_points(positions: Float64, radius: float) -> Index:
    """Number the connected clusters of points, where points no farther apart than ``radius`` are connected.

    Two points are in one cluster if and only if steps of at most ``radius`` from point to point lead from one to the other. Steps
    within a billionth of the radius, or within what the coordinates are rounded to, may count as either.

    Memory is linear in the points, whatever their density. So is time in practice: five million points take 1 to 3 s, five million
    that are all strays 10 s. The worst are dense surfaces that face each other everywhere at just over the radius: two concentric
    balls of five million points take over a minute.

    Args:
        positions: (P, D) finite, D 2 or 3; radius: positive, in the same unit.
    Returns:
        (P,) numbers 0, 1, … in the order in which clusters first occur among the points.
    Raises:
        ValueError: the radius is not positive.
    """
    if not radius > 0:
        raise ValueError(f"radius is {radius}, it must be positive")
    positions = np.asarray(positions, dtype=np.float64)
    if not len(positions):
        return np.zeros(0, dtype=np.int64)
    order, first, cells = _cells(positions, radius / np.sqrt(positions.shape[1]) * SHRINK)
    points = positions[order]
    boxes = np.stack([extreme.reduceat(points, first[:-1], axis=0) for extreme in (np.minimum, np.maximum)], axis=1)
    parent = np.arange(len(cells))
    for offset in _offsets(positions.shape[1]):
        _join_cells(points, first, cells, boxes, offset, float(radius), parent)
    return _numbers(parent, order, first)


def _cells(positions: Float64, side: float) -> tuple[Index, Index, Index]:
    """Points sorted by cell: the order (P,), stable; where each cell's points begin in it (C + 1,); the sorted cells (C, D)."""
    columns = [np.floor((x - x.min()) / side).astype(np.int64) for x in positions.T]
    order = np.lexsort(columns[::-1]).astype(np.int64)
    begins = np.zeros(len(positions), dtype=bool)
    begins[0] = True
    for k, column in enumerate(columns):
        columns[k] = column = column[order]
        begins[1:] |= column[1:] != column[:-1]
    first = np.flatnonzero(begins)
    return order, np.append(first, len(positions)), np.stack([column[first] for column in columns], axis=1)


def _offsets(dimensions: int) -> Index:
    """Half of the cells about a cell that may hold a point within the radius, as steps (K, D), the nearest first."""
    # A radius is as long as a cell's diagonal: less than two cells along any axis.
    steps = [o for o in product(range(-2, 3), repeat=dimensions) if o > (0,) * dimensions]
    return np.array(sorted(steps, key=lambda o: (sum(x * x for x in o), o)), dtype=np.int64)


def _numbers(parent: Index, order: Index, first: Index) -> Index:
    """The cluster (P,) of each point, numbered in the order of first occurrence, from the cells' parents (C,)."""
    roots = _roots(parent)
    earliest = np.full(len(parent), len(order))
    np.minimum.at(earliest, roots, order[first[:-1]])
    heads = np.unique(roots)
    rank = np.empty_like(earliest)
    rank[heads[np.argsort(earliest[heads])]] = np.arange(len(heads))
    numbers = np.empty(len(order), dtype=np.int64)
    numbers[order] = np.repeat(rank[roots], np.diff(first))
    return numbers


@njit(cache=True)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def _roots(parent):
    roots = np.empty_like(parent)
    for i in range(len(parent)):
        roots[i] = _root(parent, i)
    return roots


@njit(cache=True)
def _join_cells(points, first, cells, boxes, offset, radius, parent):
    """Unite each cell with the one a step away, where points of the two are near; reorders points within their cells.

    Both run through the sorted cells at the same time.
    """
    count, dimensions = cells.shape
    waiting, around = np.empty((DEEPEST, 4), np.int64), np.empty((DEEPEST, 2, 2, dimensions))
    other = 0
    for own in range(count):
        ahead = -1
        while other < count:
            for k in range(dimensions):
                ahead = cells[other, k] - cells[own, k] - offset[k]
                if ahead != 0:
                    break
            if ahead >= 0:
                break
            other += 1
        if other == count:
            break
        if ahead > 0:
            continue
        i, j = _root(parent, own), _root(parent, other)
        if i == j or _apart(boxes[own], boxes[other]) > radius * radius:
            continue
        waiting[0, 0], waiting[0, 1] = first[own], first[own + 1]
        waiting[0, 2], waiting[0, 3] = first[other], first[other + 1]
        _copy(boxes[own], around[0, 0])
        _copy(boxes[other], around[0, 1])
        if _meet(points, radius, waiting, around):
            parent[max(i, j)] = min(i, j)


@njit(cache=True)
def _apart(a, b):
    """The smallest squared distance of two boxes (2, D)."""
    total = 0.0
    for k in range(a.shape[1]):
        total += max(a[0, k] - b[1, k], b[0, k] - a[1, k], 0.0) ** 2
    return total


@njit(cache=True)
def _meet(points, radius, waiting, around):
    """Whether a point of one range is within the radius of one of another.

    Args:
        waiting: (DEEPEST, 4) begin and end of two ranges in row 0; the rest is room for their parts.
        around: (DEEPEST, 2, 2, D) the boxes around the two likewise.
    """
    reach, dimensions, pending = radius * radius, points.shape[1], 1
    part, mate = np.empty((2, 2, dimensions)), np.empty((2, dimensions))
    while pending > 0:
        pending -= 1
        a0, a1, b0, b1 = waiting[pending, 0], waiting[pending, 1], waiting[pending, 2], waiting[pending, 3]
        # The longest side is halved.
        longest, which, axis, farthest = -1.0, 0, 0, 0.0
        for k in range(dimensions):
            for w in range(2):
                side = around[pending, w, 1, k] - around[pending, w, 0, k]
                if side > longest:
                    longest, which, axis = side, w, k
            beyond = max(
                around[pending, 0, 1, k] - around[pending, 1, 0, k], around[pending, 1, 1, k] - around[pending, 0, 0, k]
            )
            farthest += beyond * beyond
        if farthest <= reach or longest <= FINE * radius:
            return True
        if (a1 - a0) * (b1 - b0) <= FEW_PAIRS:
            for i in range(a0, a1):
                for j in range(b0, b1):
                    away = 0.0
                    for k in range(dimensions):
                        away += (points[i, k] - points[j, k]) ** 2
                    if away <= reach:
                        return True
            continue
        begin, end = waiting[pending, 2 * which], waiting[pending, 2 * which + 1]
        low, high = around[pending, which, 0, axis], around[pending, which, 1, axis]
        middle = low + (high - low) / 2
        cut = _partition(points, begin, end, axis, middle if middle < high else low)
        _surround(points, begin, cut, part[0])
        _surround(points, cut, end, part[1])
        _copy(around[pending, 1 - which], mate)
        front, back = _apart(part[0], mate), _apart(part[1], mate)
        for turn in range(2):
            # The nearer part comes last, so that it is looked at first.
            chosen = turn if front > back else 1 - turn
            if (front if chosen == 0 else back) > reach:
                continue
            waiting[pending, 0], waiting[pending, 1], waiting[pending, 2], waiting[pending, 3] = a0, a1, b0, b1
            waiting[pending, 2 * which + 1 - chosen] = cut
            _copy(part[chosen], around[pending, which])
            _copy(mate, around[pending, 1 - which])
            pending += 1
    return False


@njit(cache=True)
def _copy(box, into):
    for k in range(box.shape[1]):
        into[0, k], into[1, k] = box[0, k], box[1, k]


@njit(cache=True)
def _partition(points, begin, end, axis, middle):
    """Bring points up to the middle to the front of a range; where the others begin."""
    cut = begin
    for i in range(begin, end):
        if points[i, axis] <= middle:
            for k in range(points.shape[1]):
                points[i, k], points[cut, k] = points[cut, k], points[i, k]
            cut += 1
    return cut


@njit(cache=True)
def _surround(points, begin, end, box):
    """The box (2, D) around a range of points."""
    for k in range(points.shape[1]):
        box[0, k] = box[1, k] = points[begin, k]
        for i in range(begin + 1, end):
            box[0, k] = min(box[0, k], points[i, k])
            box[1, k] = max(box[1, k], points[i, k])
