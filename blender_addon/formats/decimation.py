# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with fewer triangles, for the view: vertices are merged by the cells of a grid. No bpy here.

A triangle goes only where its corners fall into fewer than three cells, or where another one has the same three, so that no
hole opens in a road or a wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Decimated", "decimated"]

NEAR = 0.95
"""Of the most triangles, that a cell size is looked for: two triangles for each vertex is true of a surface without edges."""
ENOUGH = 0.9
"""Of the cells that are looked for, with which the search ends."""
TRIES = 16
"""Cell sizes that are tried at most. A street needs three or four."""
LEAST_CELL = 1e-15
"""Of the diagonal: numbers of layers stay exact."""
SLOTS = 1 << 25
"""In which cells are counted, by the rest of their numbers where there are more: those that share one are counted once, under
1 % of 300,000."""


@dataclass(frozen=True, eq=False)
class Decimated:
    """A mesh for the view.

    Attributes:
        vertices: (V, 3); triangles: (F, 3) that name them; colors: (V, 3) uint8, None where there were none.
        cell: edge of the grid's cells, in the units of the vertices; 0 where the mesh is as it was.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    colors: np.ndarray | None
    cell: float = 0.0


def decimated(vertices: np.ndarray, triangles: np.ndarray, colors: np.ndarray | None, most: int) -> Decimated:
    """A mesh of at most so many triangles; as it is where it has no more.

    A cell's vertices become one, at their mean and in their mean colour.

    Args:
        vertices: (V, 3) finite; triangles: (F, 3) that name them; colors: (V, 3) uint8 or None.
    """
    if len(triangles) <= most:
        return Decimated(vertices, triangles, colors)
    low = vertices.min(axis=0)
    local = np.asfortranarray(vertices - low)  # by columns, as it is read from here on
    wanted = NEAR * most / 2
    while True:
        cell = _cell_for(local, wanted)
        of_vertex = _numbered(_cells(local, cell))
        kept = _kept(of_vertex[triangles])
        if len(kept) <= most:
            break
        wanted *= 0.9 * most / len(kept)
    used = np.zeros(int(of_vertex.max()) + 1, bool)
    used[kept] = True
    places = _means(local, of_vertex)[used] + low
    shown = None if colors is None else np.round(_means(colors, of_vertex)[used]).astype(np.uint8)
    return Decimated(places, (np.cumsum(used) - 1)[kept].astype(np.int32), shown, cell)


def _cells(local: np.ndarray, cell: float) -> np.ndarray:
    """(V,) int64, a number for the cell that each vertex is in."""
    places = [(column * (1 / cell)).astype(np.int64) for column in local.T]
    counts = [int(place.max()) + 1 for place in places]
    if counts[0] * counts[1] * counts[2] > 1 << 62:  # something lies far outside: number the layers that are not empty
        places = [np.unique(place, return_inverse=True)[1] for place in places]
        counts = [int(place.max()) + 1 for place in places]
    number = places[0]
    for place, count in zip(places[1:], counts[1:], strict=True):
        number *= count
        number += place
    return number


def _numbered(cells: np.ndarray) -> np.ndarray:
    """(V,) the same cells by numbers without gaps, from 0."""
    if int(cells.max()) >= SLOTS:
        return np.unique(cells, return_inverse=True)[1]
    taken = np.zeros(int(cells.max()) + 1, bool)
    taken[cells] = True
    return (np.cumsum(taken, dtype=np.int32) - 1)[cells]


def _cell_for(local: np.ndarray, wanted: float) -> float:
    """The size of cells of which about so many hold a vertex, and not more."""
    diagonal = float(np.linalg.norm(local.max(axis=0)))
    whole = 2 * diagonal or 1.0  # one cell for everything
    if diagonal == 0 or wanted < 2:
        return whole
    best, most = whole, 0
    cell = diagonal / wanted**0.5
    for _ in range(TRIES):
        if not diagonal * LEAST_CELL < cell <= whole:
            break
        taken = np.zeros(SLOTS, bool)
        taken[_cells(local, cell) & (SLOTS - 1)] = True
        count = int(np.count_nonzero(taken))
        if most < count <= wanted:
            best, most = cell, count
        if ENOUGH * wanted <= count <= wanted:
            break
        cell *= (count / (wanted * (1 + ENOUGH) / 2)) ** 0.5
    return best


def _kept(corners: np.ndarray) -> np.ndarray:
    """(F, 3) of the triangles, given by the cells of their corners, that are left, each once and in the order of the file."""
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    ordered = np.sort(corners, axis=1)
    if not len(ordered):
        return corners
    order = np.lexsort(ordered.T)
    ordered = ordered[order]
    first = np.ones(len(ordered), bool)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return corners[np.sort(order[first])]


def _means(values: np.ndarray, of_vertex: np.ndarray) -> np.ndarray:
    """(C, 3) means of values (V, 3) by cell."""
    counts = np.bincount(of_vertex)
    return np.stack([np.bincount(of_vertex, column) / counts for column in values.T], axis=1)
