"""The ground of a drive, fitted to the surfels that lie on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.ground.street import Ground, StreetPath, fit_ground, fit_path
from unveil_core.semantics.classes import GROUND_CLASSES, SIDE_CLASSES, LabelSet
from unveil_core.surfels.surfels import Surfels

__all__ = ["fit_drive_ground"]


def fit_drive_ground(
    surfels: Surfels, labels: LabelSet, cameras: Sequence[Camera], up: NDArray[np.float64], *,
    path: StreetPath | None = None,
) -> Ground | None:  # fmt: skip
    """The ground from the surfels that lie on it: by label, or, in a scene without classes, the level ones underfoot.

    Args:
        surfels: the full scene.
        cameras: of the first track, in order of travel.
        path: the street's, where more is known of it than the way that the cameras took.
    Returns:
        the ground, or None where too few surfels lie on any.
    """
    path = fit_path(list(cameras), up) if path is None else path
    means = surfels.means.double().numpy()
    opaque = surfels.opacity_logits.numpy() > -1.0
    wanted = labels.indices(GROUND_CLASSES)
    if wanted:
        chosen = np.isin(surfels.labels.numpy(), wanted) & opaque
    else:
        level = np.abs(surfels.normals().double().numpy() @ (up / np.linalg.norm(up))) > 0.8
        street = path.to_street(means)
        centres = np.stack([c.centre for c in cameras])
        track = path.to_street(centres)
        order = np.argsort(track[:, 0])
        eye = np.interp(street[:, 0], track[order, 0], track[order, 2])
        drop = eye - street[:, 2]
        near = np.abs(street[:, 1]) < 3.0
        keep = near & level & opaque & (drop > 0.5) & (drop < 3.0)
        if keep.sum() < 50:
            return None
        typical = float(np.median(drop[keep]))
        chosen = level & opaque & (np.abs(drop - typical) < 0.35) & (np.abs(street[:, 1]) < 8.0)
    if chosen.sum() < 50:
        return None
    sides = labels.indices(SIDE_CLASSES)
    walls = means[np.isin(surfels.labels.numpy(), sides) & opaque] if sides else None
    return fit_ground(path, means[chosen], walls=walls)
