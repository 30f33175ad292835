"""Which surfels are removed: those of the chosen classes and instances, and those too close to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.mechanisms import on
from unveil_core.geometry.grid import PointGrid
from unveil_core.semantics.instances import Box, fit_box, without_strays
from unveil_core.semantics.labels import SceneLabels
from unveil_core.semantics.members import Members
from unveil_core.surfels.surfels import Surfels

__all__ = ["LONGEST_M", "WIDEST_M", "Selection", "near_removed", "select_removed"]

MARGIN_M = 0.15
"""Uncertainty of an object's box, metres; what lies no higher than this over its floor is the ground."""
BUS_M, LONGEST_M, WIDEST_M, GAP_M = 12.0, 25.0, 3.5, 0.4
"""Metres. A box that is longer than a bus is one vehicle's up to the second length, a road train's, if it is no wider than the
third and nowhere along it lies a gap of the fourth: cars parked in a row leave half a metre and more."""
CELL_M, SLACK_M = 4.0, 0.01
"""Metres. Side of the cells in which surfels are looked for near an object, about its length; and how far beyond its box they are
looked for, more than any rounding."""
HANGING_M, REACH_M = 0.5, 3.0
"""Metres. The floor of a box hangs in the air if what lies under it, at most ``REACH_M`` down, is more than ``HANGING_M`` lower."""


@dataclass(frozen=True, eq=False)
class Selection:
    """Attributes:
    removed: (N,) surfels that are removed.
    not_one: boxes by id of the objects whose box takes nothing, since it is not that of one vehicle.
    """

    removed: NDArray[np.bool_]
    not_one: dict[int, Box]


def select_removed(
    surfels: Surfels,
    instance_of_surfel: NDArray[np.int64],
    scene: SceneLabels,
    *,
    too_close: float,
    axes: NDArray[np.float64] | None = None,
    ground: NDArray[np.bool_] | None = None,
) -> Selection:
    """The surfels that are removed.

    Surfels within a removed object's box and off the ground are removed with it, whatever their label: they are the object's
    reflections and badly placed background.

    Args:
        surfels: the full scene; instance_of_surfel: (N,) ids, 0 = none.
        scene: with the chosen classes and instances.
        too_close: surfels of other labels nearer than this to a removed one are removed too (their colour is that of its border);
            metres.
        axes: (3, 3) rows east, north, up of the drive; None leaves the boxes out.
        ground: (N,) surfels that lie where the ground is known to lie: no box takes them; None = not known.
    """
    labels = surfels.labels.numpy()
    chosen, not_one = np.isin(labels, scene.removed_labels), {}
    if scene.instances:
        chosen |= np.isin(instance_of_surfel, scene.instances)
    if axes is not None and on("object_boxes"):
        means = surfels.means.detach().to(torch.float64).numpy()
        others = np.flatnonzero(~np.isin(labels, scene.removable_labels))
        # An object is compared with what is near it, not with all surfels of a long drive.
        grid, members = PointGrid(means[others] @ axes.T, CELL_M), Members(instance_of_surfel)
        for instance in np.unique(instance_of_surfel[chosen]):
            if instance == 0:  # belongs to no object
                continue
            own = members[instance]
            own = own[chosen[own]]
            box = fit_box(without_strays(means[own]), axes, gap=1.0)
            if not _is_one(box, means[own], axes):
                not_one[int(instance)] = box
                continue
            half = float(np.hypot(*(np.asarray(box.size[:2]) / 2 + MARGIN_M)))
            near = others[grid.near(axes @ np.asarray(box.centre), half + SLACK_M)]
            # What its floor stands on stays, but under a floor that hangs in the air there is no ground to spare.
            above = -MARGIN_M if _hangs(box, means[near], axes) else MARGIN_M
            inside = near[box.contains(means[near], axes, margin=MARGIN_M, above=above)]
            chosen[inside if ground is None else inside[~ground[inside]]] = True
    return Selection(_with_border(surfels, chosen, too_close) if on("border_surfels") else chosen, not_one)


def _with_border(surfels: Surfels, chosen: NDArray[np.bool_], too_close: float) -> NDArray[np.bool_]:
    """(N,) the chosen surfels, and those that touch one: of what labels cut a little too small, no rim stays."""
    return chosen | near_removed(surfels, chosen, too_close)


def _is_one(box: Box, points: NDArray[np.float64], axes: NDArray[np.float64]) -> bool:
    """Whether a box is that of one object, not of several that touch, whose common box would take the street with it.

    Args:
        points: (M, 3) of the object.
    """
    length, width = max(box.size[:2]), min(box.size[:2])
    if length <= BUS_M:
        return True
    if length > LONGEST_M or width > WIDEST_M:
        return False
    local = points @ axes.T
    turn = box.yaw if box.size[0] >= box.size[1] else box.yaw + np.pi / 2
    along = np.sort(local[:, 0] * np.cos(turn) + local[:, 1] * np.sin(turn))
    return bool(np.diff(along).max(initial=0.0) < GAP_M)


def _hangs(box: Box, kept: NDArray[np.float64], axes: NDArray[np.float64]) -> bool:
    """Whether a box begins well above what lies under it: the foot of an object that the images cut off was never seen.

    Args:
        kept: (M, 3) positions near it that belong to no object.
    """
    under = box.contains(kept, axes, margin=MARGIN_M, above=-REACH_M)
    height = kept[under] @ axes[2] - (np.asarray(box.centre) @ axes[2] - box.size[2] / 2)
    height = height[height < MARGIN_M]
    # A tenth may be badly placed.
    return len(height) >= 10 and bool(np.percentile(height, 10) < -HANGING_M)


def near_removed(surfels: Surfels, removed: NDArray[np.bool_], distance: float) -> NDArray[np.bool_]:
    """(N,) True for surfels not in ``removed`` whose centre lies within ``distance`` of one that is."""
    near = np.zeros(len(surfels), dtype=bool)
    if removed.any() and not removed.all():
        means = surfels.means.detach().to(torch.float64).numpy()
        gap = cKDTree(means[removed]).query(means[~removed], distance_upper_bound=distance)[0]
        near[np.flatnonzero(~removed)] = np.isfinite(gap)
    return near
