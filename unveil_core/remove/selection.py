"""Which surfels go: those of the chosen classes and instances, and those too close to them."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.semantics.segment import SceneLabels
from unveil_core.surfels.surfels import Surfels

__all__ = ["near_removed", "select_removed"]


def select_removed(
    surfels: Surfels, instance_of_surfel: NDArray[np.int64], scene: SceneLabels, *, too_close: float
) -> NDArray[np.bool_]:
    """(N,) True where a surfel goes.

    Args:
        surfels: the full scene; instance_of_surfel: (N,) ids, 0 = none.
        scene: with the chosen classes and instances.
        too_close: surfels of other labels nearer than this to one that goes, go too (their colour is of its border);
            world units.
    """
    labels = surfels.labels.numpy()
    chosen = np.isin(labels, scene.removed_labels)
    if scene.instances:
        chosen |= np.isin(instance_of_surfel, scene.instances)
    return chosen | near_removed(surfels, chosen, too_close)


def near_removed(surfels: Surfels, removed: NDArray[np.bool_], distance: float) -> NDArray[np.bool_]:
    """(N,) True for surfels not in ``removed`` whose centre lies within ``distance`` of one that is."""
    near = np.zeros(len(surfels), dtype=bool)
    if removed.any() and not removed.all():
        means = surfels.means.detach().to(torch.float64).numpy()
        gap = cKDTree(means[removed]).query(means[~removed], distance_upper_bound=distance)[0]
        near[np.flatnonzero(~removed)] = np.isfinite(gap)
    return near
