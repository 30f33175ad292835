"""What of a long drive's scene a camera is given to render: the rest is too far to be more than a speck."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from weakref import WeakKeyDictionary

import numpy as np
import torch

from unveil_core.geometry.camera import Camera
from unveil_core.surfels.surfels import Surfels

__all__ = ["REACH_M", "near_camera", "near_cameras", "near_runs"]

REACH_M = 200.0
"""How far a camera is given surfels, metres: as far as a block's frames see. A house fills five pixels there."""
SPECK, WIDE_M = 1e-3, 1.0
"""Standard deviation of a surfel over its distance, about a pixel's width, and in metres, beyond both of which it is no speck: what
stands for a skyline is given however far it is, and of the street itself nothing is so wide."""
CELL_M = 25.0
"""Side of the cells whose cameras are given the same surfels, metres: some twenty frames of a drive."""

_chosen: WeakKeyDictionary[Surfels, tuple[tuple[int, int], Surfels | None]] = WeakKeyDictionary()
"""For each scene the last cell that was asked for, and its surfels; None for all, for its own entry must not keep a scene."""


def near_camera(surfels: Surfels, camera: Camera) -> Surfels:
    """The surfels that a camera may show: all within ``REACH_M``, and beyond those that are no specks; of a short drive all.

    The time of a frame then does not grow with the length of the drive. For rendering only: what is not given gets no gradient.
    """
    cell = _cell(camera)
    known = _chosen.get(surfels)
    if known is not None and known[0] == cell:
        return surfels if known[1] is None else known[1]
    near = _near_cell(surfels, cell)
    given = None if bool(near.all()) else surfels.select(near)
    _chosen[surfels] = (cell, given)
    return surfels if given is None else given


def near_cameras(surfels: Surfels, cameras: Sequence[Camera]) -> Surfels:
    """All that :func:`near_camera` gives one of some cameras, in the same order."""
    near = torch.zeros(len(surfels), dtype=torch.bool)
    for cell in sorted({_cell(camera) for camera in cameras}):
        near |= _near_cell(surfels, cell)
    return surfels if bool(near.all()) else surfels.select(near)


def near_runs(surfels: Surfels, cameras: Sequence[Camera]) -> Iterator[tuple[list[Camera], torch.Tensor]]:
    """The cameras in their order, those of one place together, and (N,) which surfels :func:`near_camera` gives them."""
    for cell, run in groupby(cameras, _cell):
        yield list(run), _near_cell(surfels, cell)


def _cell(camera: Camera) -> tuple[int, int]:
    east, north = np.floor(camera.centre[:2] / CELL_M).astype(int).tolist()
    return east, north


def _near_cell(surfels: Surfels, cell: tuple[int, int]) -> torch.Tensor:
    """(N,) which surfels are near some place in a cell."""
    middle = torch.tensor([(c + 0.5) * CELL_M for c in cell])
    # Half of the diagonal: whatever is within reach of some place in the cell.
    reach = REACH_M + CELL_M / 2**0.5
    away = (surfels.means.detach()[:, :2] - middle).norm(dim=1)
    return (away < reach) | (surfels.log_scales.detach().amax(dim=1).exp() > torch.clamp(SPECK * away, min=WIDE_M))
