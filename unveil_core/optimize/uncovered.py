"""Surfels for what the points leave uncovered: upper facades, treetops, the far end of the street.

Only sky may be left to the panorama behind the surfels, or the optimization stretches what is near to cover what is far.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from unveil_core.base.frame_cache import Frames
from unveil_core.base.types import Levels
from unveil_core.drives.depth_range import FAR_M, FARTHEST_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.ground_start import GroundStart
from unveil_core.raster.on_device import array, rendered
from unveil_core.semantics.visibility import points_in_view
from unveil_core.semantics.votes import label_share, vote_labels
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["cover_uncovered"]

STEP = 2
"""Pixels between seeds, and by which the views are coarser that they are found in."""
COVERED = 0.5
AGREEMENT = 0.6
"""Least share of the views' votes that a planted surfel's label must have."""
AMID = 0.9
"""Least share of its own label around a pixel: neither noise nor a wide surfel at a border may cover sky."""


def _confirmed(
    surfels: Surfels,
    cameras: Sequence[Camera],
    labels: Sequence[NDArray[np.int64]],
    label_count: int,
) -> Tensor:
    """(N,) bool, where the views that see a surfel agree with its label: one view alone may be wrong in a whole patch."""
    positions = surfels.means.double().numpy()
    spacing = surfels.log_scales.exp().amax(1).double().numpy()
    facing = surfels.normals().double().numpy()
    views = Frames(len(cameras), lambda v: points_in_view(positions, spacing, cameras[v], near=NEAR_M, normals=facing))
    label, agreement = vote_labels(len(positions), views, lambda v: labels[v], label_count)
    return torch.from_numpy((label == surfels.labels.numpy()) & (agreement > AGREEMENT))


def cover_uncovered(
    surfels: Surfels,
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    label_count: int,
    sky: int | None,
    up: NDArray[np.float64],
    ground: GroundStart | None = None,
) -> Surfels:
    """Add surfels where a view shows something, but the surfels so far leave most of its light through.

    They stand as far away as the nearest covered pixel of the same label in the image, at the far end of the range without
    any, and face the view; what one view has planted covers it in the next ones. Those
    stay whose label most views confirm.

    Args:
        surfels: the start so far.
        cameras, images: the views, (H, W, 3) levels of 255; labels: (H, W) compact, negative = unknown, left alone;
            label_count: K.
        sky: its label; None = unknown, then pixels above the horizon count as sky. up: (3,) unit.
        ground: what of the views shows it, and where it is; None = they stand on nothing.
    """
    before = len(surfels)
    for i, (camera, image, label) in enumerate(zip(cameras, images, labels, strict=True)):
        small = camera.resized(max(1, camera.width // STEP), max(1, camera.height // STEP))
        planes = ("alpha", "median_depth", "semantics")
        out = rendered(surfels, small, planes, label_count=label_count, near=NEAR_M, far=FAR_M)
        assert out.median_depth is not None and out.semantics is not None
        # What stands at a covered pixel may be the rim of something else than the image shows there.
        standing = array(out.semantics.argmax(2))
        alpha, depth = array(out.alpha), array(out.median_depth.double())
        row = ((np.arange(small.height) + 0.5) * camera.height / small.height).astype(np.int64)
        column = ((np.arange(small.width) + 0.5) * camera.width / small.width).astype(np.int64)
        shown, rays = label[np.ix_(row, column)], small.rays()
        empty = (alpha < COVERED) & (shown >= 0) & ((rays @ up <= 0) if sky is None else (shown != sky))
        rows, columns = np.nonzero(empty)
        amid = label_share(label, row[rows], column[columns]) >= AMID
        rows, columns = rows[amid], columns[amid]
        if not len(rows):
            continue
        kind, away = shown[rows, columns], np.full(len(rows), FARTHEST_M)
        for k in np.unique(kind):
            known = (alpha >= COVERED) & (shown == k) & (standing == k) & (depth > NEAR_M)
            if known.any():
                nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
                of_k = kind == k
                away[of_k] = depth[tuple(nearest[:, rows[of_k], columns[of_k]])]
        ray = rays[rows, columns]
        facing = -ray / np.linalg.norm(ray, axis=1, keepdims=True)
        if ground is not None:
            lies = ground.shown[i][row[rows], column[columns]]
            met = np.full(len(ray), np.inf)
            met[lies] = ground.street.intersect(camera, ray[lies])[0]
            lies &= met < FARTHEST_M
            away[lies], facing[lies] = met[lies], up
        seeds = surfels_from_points(
            camera.centre + away[:, None] * ray,
            image[row[rows], column[columns]],
            kind,
            facing,
            away / small.fx,
            sh_degree=surfels.sh_degree,
            opacity=0.7,
            scale_factor=0.5,
        )
        surfels = concatenate([surfels, seeds])
    if len(surfels) == before:
        return surfels
    kept = _confirmed(surfels, cameras, labels, label_count)
    kept[:before] = True
    return surfels.select(kept)
