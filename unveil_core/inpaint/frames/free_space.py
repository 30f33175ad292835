"""Free space: what cameras saw through. Nothing that is invented may hang there.

The depth of a hole is continued from around it, and what is around a far car is often a hedge or a pole beside the road, much
nearer than what the car hides. Carried to other frames on such a depth, what was invented for the end of the street hangs over the
road before them. But a place is known to be empty where some frame shows what lies farther along the same ray, the removed object
itself among it (space carving, Kutulakos and Seitz 2000). So a hole's pixels are pushed back along their rays until no frame sees
through them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import cameras_near, centres_of

__all__ = ["FreeSpace"]

STEP = 1.1
"""Ratio of the depths that are tried one after the other."""
BEFORE, BEFORE_M = 0.1, 0.3
"""Share of a surface's depth, plus metres, by which a place must lie before it to be seen through: rendered depths are as
uncertain."""
REACH_M = 60.0
"""Distance up to which a frame is asked about a place, metres: twice as far as what is invented is carried. From farther off
rendered depth is wrong by metres, and the time of a long drive must not grow with the square of its length."""
ASKED_PX = 2000
"""Pixels of a hole that are asked for; of larger holes one of each block."""


class FreeSpace:
    """What the cameras of a drive saw through.

    Args:
        cameras: of the frames.
        depths: (H, W) depth per frame of what it shows, the removed objects included; inf where that is the sky.
    """

    def __init__(self, cameras: Sequence[Camera], depths: Sequence[Float32]) -> None:
        self.cameras, self.depths = cameras, depths
        self.centres = centres_of(cameras)

    def behind(self, camera: Camera, mask: Mask, depth: Float64, *, ceiling: Float64, furthest: float) -> Float64:
        """Depths (H, W), those of the pixels of ``mask`` pushed back to the first place that no frame sees through.

        Args:
            camera: of the pixels; mask: (H, W); depth: (H, W) where the search begins, along the optical axis.
            ceiling: (H, W) depth behind which nothing lies, inf where there is no such.
            furthest: depth at which the search ends, metres; what finds no place lies behind it.
        """
        rows, columns = np.nonzero(mask)
        if not len(rows):
            return depth
        step = max(1, math.ceil(math.sqrt(len(rows) / ASKED_PX)))
        _, asked, block = np.unique(
            (rows // step) * mask.shape[1] + columns // step, return_index=True, return_inverse=True
        )
        row, column = rows[asked], columns[asked]
        rays, begin, end = camera.rays()[row, column], depth[row, column], ceiling[row, column]
        ratio = np.ones(len(row))
        open_ = np.flatnonzero(begin < np.minimum(end, furthest))
        while len(open_):
            at = np.minimum(begin[open_] * ratio[open_], end[open_])
            open_ = open_[self._seen_through(camera.centre + at[:, None] * rays[open_])]
            ratio[open_] *= STEP
            open_ = open_[begin[open_] * ratio[open_] < np.minimum(end[open_], furthest)]
        found = depth.copy()
        found[rows, columns] = np.minimum(depth[rows, columns] * ratio[block.ravel()], ceiling[rows, columns])
        return found

    def _seen_through(self, places: Float64) -> Mask:
        """(P,) whether cameras saw what lies behind places (P, 3)."""
        seen = np.zeros(len(places), dtype=bool)
        for j in cameras_near(self.centres, places, REACH_M).tolist():
            open_ = np.flatnonzero(~seen)
            if not len(open_):
                break
            which, pixel, depth = self.cameras[j].shown(places[open_])
            column, row = pixel.astype(np.int64).T
            if len(which):
                through = depth < (1 - BEFORE) * self.depths[j][row, column] - BEFORE_M
                seen[open_[which[through]]] = True
        return seen
