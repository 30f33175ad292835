"""Ground a shift away: world points of street coordinates, many at a time."""

from __future__ import annotations

import numpy as np

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float64
from unveil_core.delivery.kernels import CHUNK, place_points
from unveil_core.ground.street import Ground

__all__ = ["ground_points"]


def ground_points(ground: Ground, street: Float64) -> Float64:
    """(N, 3) world points of the ground at street coordinates (N, 2): ``StreetPath.to_world`` with ``Ground.height_at``, for the
    hundreds of thousands of pixels of a frame of the footage."""
    path, points = ground.path, np.empty((len(street), 3))
    cells = np.array([ground.s_start, ground.t_start, ground.s_cell, ground.t_cell])
    grid = (np.ascontiguousarray(ground.height), cells)
    way = (np.ascontiguousarray(path.nodes), np.ascontiguousarray(path.heading), float(path.start), float(path.step))
    in_parallel(place_points, len(street), CHUNK, street, *grid, *way, np.ascontiguousarray(path.axes), points)
    return points
