"""What moves in a drive, where labels tell nothing: found by motion, outlined by colours."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.images import disc, within
from unveil_core.labelling.outlines import cut
from unveil_core.marking.space.scene_points import ScenePoints
from unveil_core.marking.space.static_depth import static_depth
from unveil_core.movers.by_motion import things_that_move

__all__ = ["moving_masks"]

FLOW_SIDE = 512
"""Longer side of the pictures in which motion is sought, pixels: flow is as sure there, and done in a quarter of the time."""
SURE, BESIDE = 0.12, 0.1
"""How far inside of a moving patch is surely the thing's own, and how far beside it may be: shares of its size."""


def moving_masks(
    drive: Drive, points: ScenePoints, image: Callable[[int], NDArray[np.uint8]], progress: Progress = no_progress
) -> list[dict[int, Mask]]:
    """Pixels (H, W) of each thing that moves, by the index of the frame; none where the drive shows no ground.

    Args:
        drive: imported; points: of its scene.
        image: gives the photograph (H, W, 3) of a frame.
    """
    found: list[dict[int, Mask]] = []
    if points.ground is None:
        return found
    cameras = [f.camera for f in drive.frames]
    factor = min(1.0, FLOW_SIDE / max(max(c.width, c.height) for c in cameras))
    small = [c if factor == 1 else c.resized(round(c.width * factor), round(c.height * factor)) for c in cameras]

    def picture(v: int) -> NDArray[np.uint8]:
        size = (small[v].width, small[v].height)
        return image(v) if factor == 1 else cv2.resize(image(v), size, interpolation=cv2.INTER_AREA).astype(np.uint8)

    for track in tracks(drive):
        things = things_that_move(
            small, track, picture, lambda v: static_depth(cameras[v], small[v], points, v), points.ground, progress
        )
        for thing in things:
            found.append({v: _outlined(image(v), mask) for v, mask in thing.masks.items()})
    return found


def _outlined(image: NDArray[np.uint8], patch: Mask) -> Mask:
    """(H, W) pixels of a thing in a photograph (H, W, 3), about where a patch (h, w) of a smaller one moves."""
    height, width = image.shape[:2]
    patch = cv2.resize(patch.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    size = float(np.sqrt(patch.sum()))
    closed = cv2.morphologyEx(patch.astype(np.uint8), cv2.MORPH_CLOSE, disc(1 + SURE * size)).astype(bool)
    state = np.full(patch.shape, cv2.GC_BGD, np.uint8)
    possible = within(closed, BESIDE * size)
    state[possible] = cv2.GC_PR_BGD
    state[closed] = cv2.GC_PR_FGD
    state[cv2.erode(closed.astype(np.uint8), disc(SURE * size)) > 0] = cv2.GC_FGD
    rows, columns = (np.flatnonzero(within(possible, 4 + 2 * BESIDE * size).any(axis=k)) for k in (1, 0))
    window = (slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1))
    found = np.zeros(patch.shape, dtype=bool)
    found[window] = cut(image[window], np.ascontiguousarray(state[window]))
    return found if found.sum() > 0.5 * closed.sum() else closed
