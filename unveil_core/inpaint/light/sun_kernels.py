"""Where the shadows of points fall on the ground of a street."""

# mypy: ignore-errors
from __future__ import annotations

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT
from unveil_core.ground.path_kernels import foot_on_path

__all__ = ["draw_fallen"]

FALLS = 2
"""How often a point is moved along the light down to the height of the ground under it: the ground is flat enough for two."""


@njit(**EXACT)
def draw_fallen(begin, end, points, lights, path, ground, grid, planes):
    """Mark the cells of grids into which points fall along the light, a grid for each direction from ``begin`` to ``end``.

    Args:
        points: (N, 3) east, north and up, as ``StreetPath.axes`` turns the world; lights: (K, 3) towards the sun, likewise.
        path: corner (2,) and cell of its lookup, nearest nodes (P, Q), nodes (S, 2), heading (S,), arc length of the first node and
            step.
        ground: s and t of its first cell, cells' sides, heights (A, B).
        grid: s and t of the plane's first cell, and its cells' side.
        planes: (K, C, D) set to 1 where a point falls.
    """
    corner, cell, nearest, nodes, heading, start, step = path
    s_start, t_start, s_cell, t_cell, height = ground
    first_s, first_t, side = grid
    for k in range(begin, end):
        light = lights[k]
        for n in range(len(points)):
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            for fall in range(FALLS + 1):
                p = min(max(int(round((x - corner[0]) / cell)), 0), nearest.shape[0] - 1)
                q = min(max(int(round((y - corner[1]) / cell)), 0), nearest.shape[1] - 1)
                u, t = foot_on_path(x, y, nearest[p, q], nodes, heading, step)
                s = start + u * step
                if fall == FALLS:
                    break
                a = min(max((s - s_start) / s_cell, 0.0), height.shape[0] - 1.001)
                b = min(max((t - t_start) / t_cell, 0.0), height.shape[1] - 1.001)
                i, j = int(a), int(b)
                v, w = a - i, b - j
                near = height[i, j] * (1 - v) + height[i + 1, j] * v
                far = height[i, j + 1] * (1 - v) + height[i + 1, j + 1] * v
                rest = (z - (near * (1 - w) + far * w)) / light[2]
                x, y, z = x - rest * light[0], y - rest * light[1], z - rest * light[2]
            row, column = int(round((s - first_s) / side)), int(round((t - first_t) / side))
            if 0 <= row < planes.shape[1] and 0 <= column < planes.shape[2]:
                planes[k, row, column] = 1
