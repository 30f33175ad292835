"""Compiled parts of delivery: one pass over hundreds of thousands of positions."""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT

__all__ = ["CHUNK", "detail_between", "ground_between", "place_points", "without_edges"]

CHUNK = 8192
"""Positions that a thread takes at a time."""


@njit(**EXACT)
def detail_between(begin, stop, positions, source, difference, believed, own, between, belief):
    """See ``Detail.at``."""
    height, width = source.shape
    for k in range(begin, stop):
        x = min(max(positions[k, 0] - 0.5, 0.0), width - 1.0)
        y = min(max(positions[k, 1] - 0.5, 0.0), height - 1.0)
        j, i = int(x), int(y)
        u, v = np.float32(x - j), np.float32(y - i)
        right, below = min(j + 1, width - 1), min(i + 1, height - 1)
        nearest = source[below if v >= 0.5 else i, right if u >= 0.5 else j]
        own[k] = nearest
        total = red = green = blue = sure = np.float32(0)
        if nearest >= 0:
            for m in range(4):
                row, column = below if m >= 2 else i, right if m % 2 else j
                if source[row, column] == nearest:
                    share = (v if m >= 2 else 1 - v) * (u if m % 2 else 1 - u)
                    total += share
                    red += share * difference[row, column, 0]
                    green += share * difference[row, column, 1]
                    blue += share * difference[row, column, 2]
                    sure += share * believed[row, column]
        total = max(total, np.float32(1e-6))
        between[k, 0], between[k, 1], between[k, 2], belief[k] = red / total, green / total, blue / total, sure / total


@njit(**EXACT)
def without_edges(begin, stop, band, strength, usual):
    """Hold what is finer (N,) within what is usual, and let it fade where it is stronger around."""
    for k in range(begin, stop):
        share = min(max(np.float32(2) - strength[k] / usual, np.float32(0)), np.float32(1))
        band[k] = min(max(band[k], -usual), usual) * share


@njit(**EXACT)
def ground_between(begin, stop, positions, lattice, step, apart, met):
    """Depth, s and t (N, 3) at positions (N, 2); NaN where the four rays around do not agree."""
    height, width = lattice.shape[:2]
    for k in range(begin, stop):
        x, y = (positions[k, 0] - 0.5) / step, (positions[k, 1] - 0.5) / step
        j, i = min(max(int(x), 0), width - 2), min(max(int(y), 0), height - 2)
        u, v = x - j, y - i
        a, b, c, d = lattice[i, j, 0], lattice[i, j + 1, 0], lattice[i + 1, j, 0], lattice[i + 1, j + 1, 0]
        total, least, most = a + b + c + d, min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
        if total > 0 and least > 0 and most <= apart * least and _of_one_stretch(lattice, i, j, most, apart):
            first, second, third, fourth = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
            depth = 1.0 / (first * a + second * b + third * c + fourth * d)
            met[k, 0] = depth
            for m in range(1, 3):
                part = first * lattice[i, j, m] + second * lattice[i, j + 1, m]
                met[k, m] = (part + third * lattice[i + 1, j, m] + fourth * lattice[i + 1, j + 1, m]) * depth
        elif total != 0:
            met[k, 0] = np.nan


@njit(**EXACT)
def _of_one_stretch(lattice, i, j, most, apart):
    """Whether four rays meet the street at nearly one s: where its path folds over itself they may meet two."""
    a, b = lattice[i, j, 1] / lattice[i, j, 0], lattice[i, j + 1, 1] / lattice[i, j + 1, 0]
    c, d = lattice[i + 1, j, 1] / lattice[i + 1, j, 0], lattice[i + 1, j + 1, 1] / lattice[i + 1, j + 1, 0]
    return (max(max(a, b), max(c, d)) - min(min(a, b), min(c, d))) * most < apart


@njit(**EXACT)
def place_points(begin, stop, street, height, cells, nodes, heading, start, step, axes, points):
    """World points (N, 3) of street coordinates (N, 2) on the ground."""
    rows, columns, last = height.shape[0], height.shape[1], len(nodes) - 2
    for k in range(begin, stop):
        s, t = street[k, 0], street[k, 1]
        a = min(max((s - cells[0]) / cells[2], 0.0), rows - 1.001)
        b = min(max((t - cells[1]) / cells[3], 0.0), columns - 1.001)
        i, j = int(a), int(b)
        u, v = a - i, b - j
        up = (height[i, j] * (1 - u) + height[i + 1, j] * u) * (1 - v)
        up += (height[i, j + 1] * (1 - u) + height[i + 1, j + 1] * u) * v
        along = (s - start) / step
        node = min(max(int(along), 0), last)
        part = along - node
        angle = heading[node] + min(max(part, 0.0), 1.0) * (heading[node + 1] - heading[node])
        east = nodes[node, 0] + part * (nodes[node + 1, 0] - nodes[node, 0]) - t * math.sin(angle)
        north = nodes[node, 1] + part * (nodes[node + 1, 1] - nodes[node, 1]) + t * math.cos(angle)
        for m in range(3):
            points[k, m] = east * axes[0, m] + north * axes[1, m] + up * axes[2, m]
