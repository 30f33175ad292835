"""Where the rays of a frame meet the ground, for as many positions as its footage has pixels.

A ray is followed through a field of heights, which takes a microsecond. Over a few pixels the ground is a plane, of which the
reciprocal of the depth, and what is in proportion to it, is linear in the picture: so a coarse lattice of rays tells of all
positions between. Where the ground ends, over a crest and beside the horizon it does not, and positions get rays of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float64, Mask
from unveil_core.delivery.kernels import CHUNK, ground_between
from unveil_core.geometry.camera import Camera
from unveil_core.ground.street import Ground

__all__ = ["SeenGround", "seen_ground"]

STEP = 2
"""Pixels of working size between rays of the lattice."""
APART = 1.5
"""Times as far that one of four rays may meet the ground as another one and all be of one plane."""


@dataclass(frozen=True, eq=False)
class SeenGround:
    """The ground in one frame.

    Attributes:
        camera: of working size; ground: None where there is none.
        lattice: (A, B, 3) of rays through the centres of every other row and column of pixels: 1 / depth, s / depth and t / depth
            where they first meet the ground, 0 where they do not; NaN of those that nobody asked for.
    """

    camera: Camera
    ground: Ground | None
    lattice: Float64

    def met(self, positions: Float64) -> Float64:
        """(N, 3) depth, s and t of the ground at positions (N, 2) of the working picture; 0 where it is not met."""
        found = np.zeros((len(positions), 3))
        if self.ground is None:
            return found
        in_parallel(ground_between, len(positions), CHUNK, positions, self.lattice, STEP, APART, found)
        unsure = np.flatnonzero(np.isnan(found[:, 0]))
        found[unsure] = _met(self.ground, self.camera, positions[unsure])
        return found


def seen_ground(camera: Camera, asked: Mask, ground: Ground | None) -> SeenGround:
    """The ground at pixels of working size and at all positions between them.

    Args:
        asked: (h, w) bool, the pixels; ground: None where there is none.
    """
    lattice = np.full((asked.shape[0] // STEP + 2, asked.shape[1] // STEP + 2, 3), np.nan)
    if ground is not None:
        around = np.zeros(lattice.shape[:2], dtype=bool)
        rows, columns = (i // STEP for i in np.nonzero(asked))
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            around[rows + down, columns + right] = True
        rows, columns = np.nonzero(around)
        rays = STEP * np.stack([columns, rows], axis=1).astype(np.float64) + 0.5
        found = _met(ground, camera, rays)
        depth = found[:, :1].copy()
        found[:, 0] = 1.0
        lattice[rows, columns] = np.divide(found, depth, out=np.zeros_like(found), where=depth > 0)
    return SeenGround(camera, ground, lattice)


def _met(ground: Ground, camera: Camera, positions: Float64) -> Float64:
    """See :meth:`SeenGround.met`; by a ray for each position."""
    found = np.zeros((len(positions), 3))
    depth, street = ground.intersect(camera, camera.rays_at(positions))
    known = np.isfinite(depth)
    found[known, 0], found[known, 1:] = depth[known], street[known, :2]
    return found
