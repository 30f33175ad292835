"""Single objects among what can be removed: ids for points, boxes to click."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.clusters import connected_points
from unveil_core.semantics.visibility import PointsNear
from unveil_core.semantics.votes import view_weights

__all__ = ["Box", "cluster_points", "fit_box", "nearest_ids", "vote_instances", "without_strays"]

MANY_VOTES = 1_000_000
"""Votes that are summed up at once: 24 MB of them."""
BESIDE_M = 1.0
"""How far from an object a point may lie that no view shows within it and still be of it, metres: what is farther is a reflection,
or a wall with a wrong label, and would make a box of a person that takes half a house."""
COMPANY, SPARSE, LEAST_SURFELS = 8, 2.0, 40
"""A surfel is a stray if its eighth neighbour is farther away than so many times the distance usual in its object, and the object
has enough for that to be told. With 3 strays behind a car's windows stay; with 2 all cars of three streets keep their size."""


@dataclass(frozen=True)
class Box:
    """An upright box: centre (3,), size (length, width, height), yaw in radians of its length axis in the horizontal plane
    of ``axes`` (see :func:`fit_box`)."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float

    def contains(
        self, positions: NDArray[np.float64], axes: NDArray[np.float64], *, margin: float, above: float
    ) -> NDArray[np.bool_]:
        """(P,) points inside the box grown by ``margin``, except those lower than ``above`` over its floor."""
        local = positions @ axes.T - np.asarray(self.centre) @ axes.T
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        along, across = local[:, 0] * cos + local[:, 1] * sin, -local[:, 0] * sin + local[:, 1] * cos
        half = np.asarray(self.size) / 2
        inside = (np.abs(along) <= half[0] + margin) & (np.abs(across) <= half[1] + margin)
        inside &= (local[:, 2] <= half[2] + margin) & (local[:, 2] >= -half[2] + above)
        return inside

    def corners(self, axes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(8, 3) world positions."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ axes
        signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        corners: NDArray[np.float64] = (signs * np.asarray(self.size) / 2) @ turn + np.asarray(self.centre)
        return corners

    def to_json(self) -> dict[str, object]:
        """For instances.json."""
        return {"centre": list(self.centre), "size": list(self.size), "yaw": self.yaw}

    @staticmethod
    def from_json(content: Any) -> Box:
        """Of an entry of instances.json.

        Raises:
            KeyError, TypeError, ValueError: it is no box: centre and size of three finite numbers each, and a finite yaw.
        """
        centre, size = (np.array(content[key], dtype=np.float64) for key in ("centre", "size"))
        yaw = float(content["yaw"])
        if not centre.shape == size.shape == (3,) or not np.isfinite([*centre, *size, yaw]).all():
            raise ValueError("a box that is none")
        return Box(tuple(centre.tolist()), tuple(size.tolist()), yaw)


def vote_instances(
    positions: NDArray[np.float64],
    spacing: NDArray[np.float64],
    labels: NDArray[np.integer],
    cameras: Sequence[Camera],
    instance_image: Callable[[int], NDArray[np.integer] | None],
    *,
    near: float,
) -> NDArray[np.int64]:
    """The instance id (P,) that most views near it show at each point, 0 = none.

    A point that no view shows within an instance has that of the nearest point of its class that has one, if that is near.

    Args:
        positions, spacing: removable points and their neighbourhood, metres; labels: (P,) their classes.
        instance_image: gives (H, W) ids of view v (0 = none), or None where it has none; asked once each.
    """
    votes, placed = _SparseVotes(), PointsNear(positions, spacing)
    for v, camera in enumerate(cameras):
        image = instance_image(v)
        if image is not None:
            seen = placed.seen_by(camera, near=near)
            number = image[seen.rows, seen.columns].astype(np.int64)
            named = number > 0
            votes.add(seen.index[named], number[named], view_weights(image, seen)[named])
    voted = votes.winners(len(positions))
    for label in np.unique(labels[voted == 0]):
        own = labels == label
        unknown = own & (voted == 0)
        voted[unknown] = nearest_ids(positions[own], voted[own], positions[unknown], reach=BESIDE_M)
    return voted


def nearest_ids(
    positions: NDArray[np.float64], ids: NDArray[np.int64], asked: NDArray[np.float64], *, reach: float
) -> NDArray[np.int64]:
    """The id (Q,) of the nearest place that has one to each place ``asked`` (Q, 3), 0 where none is near.

    Args:
        positions: (P, 3); ids: (P,) theirs, 0 = none; reach: metres.
    """
    named = ids > 0
    if not named.any() or not len(asked):
        return np.zeros(len(asked), dtype=np.int64)
    gap, nearest = cKDTree(positions[named]).query(asked, distance_upper_bound=reach)
    near = np.isfinite(gap)
    return np.where(near, ids[named][np.where(near, nearest, 0)], 0)


class _SparseVotes:
    """Votes of points for ids: a drive has hundreds of objects, and each point votes for a few."""

    def __init__(self) -> None:
        self.point, self.id = (np.zeros(0, np.int64) for _ in range(2))
        self.weight = np.zeros(0)
        self.new: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []

    def add(self, point: NDArray[np.int64], number: NDArray[np.int64], weight: NDArray[np.float64]) -> None:
        """Votes (M,) of points for ids."""
        self.new.append((point, number, weight))
        if sum(len(p) for p, _, _ in self.new) > max(MANY_VOTES, len(self.point)):
            self._merge()

    def winners(self, count: int) -> NDArray[np.int64]:
        """(count,) the id with most votes of each point, the smallest of equals; 0 where nobody voted."""
        self._merge()
        found = np.zeros(count, dtype=np.int64)
        order = np.lexsort((-self.id, self.weight, self.point))
        last = np.flatnonzero(np.diff(self.point[order], append=-1))
        found[self.point[order[last]]] = self.id[order[last]]
        return found

    def _merge(self) -> None:
        point, number, weight = (
            np.concatenate([kept, *(n[k] for n in self.new)])
            for k, kept in enumerate((self.point, self.id, self.weight))
        )
        self.new = []
        order = np.lexsort((number, point))
        point, number = point[order], number[order]
        first = np.flatnonzero(np.diff(point, prepend=-1) | np.diff(number, prepend=-1))
        self.point, self.id = point[first], number[first]
        self.weight = np.add.reduceat(weight[order], first) if len(first) else np.zeros(0)


def cluster_points(positions: NDArray[np.float64], radius: float, *, minimum: int = 20) -> NDArray[np.int64]:
    """Ids (P,) 1, 2, … of connected clusters by size, 0 for crumbs of fewer than ``minimum`` points.

    Args:
        positions: (P, 3); radius: points no farther apart than this belong together, metres.
    """
    component = connected_points(positions, radius)
    counts = np.bincount(component)
    order = np.argsort(-counts, kind="stable")
    ids = np.zeros(len(counts), dtype=np.int64)
    ids[order] = np.arange(1, len(counts) + 1)
    ids[counts < minimum] = 0
    return ids[component]


def without_strays(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of an object's surfels (P, 3) those with as much company as most have: a few lie behind its panes and under the road, where
    the frames mirror what is before them, and one in fifty there is enough to make a car 10 m long."""
    if len(positions) < LEAST_SURFELS:
        return positions
    distance = cKDTree(positions).query(positions, k=COMPANY + 1)[0][:, -1]
    return positions[distance <= SPARSE * np.median(distance)]


def fit_box(positions: NDArray[np.float64], axes: NDArray[np.float64], *, gap: float | None = None) -> Box:
    """The smallest upright box around the bulk (1st to 99th percentile) of some points.

    Args:
        positions: (P, 3), P >= 1.
        axes: (3, 3) rows east, north, up of the drive.
        gap: strays farther than this from the largest connected cluster do not count, metres; None = all count.
    """
    if gap is not None and len(positions) >= 40:
        main = cluster_points(positions, gap) == 1
        positions = positions[main] if main.any() else positions
    local = positions @ axes.T
    low, high = np.percentile(local, [1, 99], axis=0)
    inside = np.all((local >= low) & (local <= high), axis=1) if len(local) > 10 else np.ones(len(local), bool)
    rectangle = cv2.minAreaRect((local[inside, :2] - local[:, :2].mean(0)).astype(np.float32))
    (cx, cy), (w, h), angle = rectangle
    yaw = np.radians(angle)
    if w < h:
        w, h, yaw = h, w, yaw + np.pi / 2
    yaw = (yaw + np.pi / 2) % np.pi - np.pi / 2
    mean = local[:, :2].mean(0)
    centre = np.array([cx + mean[0], cy + mean[1], (low[2] + high[2]) / 2]) @ axes
    return Box(
        (float(centre[0]), float(centre[1]), float(centre[2])),
        (float(w), float(h), float(high[2] - low[2])),
        float(yaw),
    )
