"""Which cameras come near some points at all: on a long drive few do, and only they are asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera

__all__ = ["CameraViews", "cameras_near", "centres_of"]

T = TypeVar("T")


def centres_of(cameras: Sequence[Camera]) -> Float64:
    """(V, 3) optical centres."""
    return np.stack([c.centre for c in cameras]) if len(cameras) else np.zeros((0, 3))


def cameras_near(centres: Float64, points: Float64, reach: float) -> NDArray[np.int64]:
    """Indices, rising, of the cameras within ``reach`` of the box around points (N, 3), metres; none where there are no points.

    Args:
        centres: (V, 3) of the cameras.
    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(_within(centres, points.min(axis=0), points.max(axis=0), reach))


def _within(places: Float64, low: Float64, high: Float64, reach: float) -> Mask:
    """(...) bool, which places (..., 3) lie within ``reach`` of a box (..., 3)."""
    gap = np.maximum(np.maximum(low - places, places - high), 0.0)
    near: Mask = (gap * gap).sum(axis=-1) <= reach * reach
    return near


@dataclass(frozen=True, eq=False)
class CameraViews(Generic[T]):
    """What all frames of a drive show.

    Attributes:
        cameras: of the frames; frames: what each shows, asked for only where it matters.
        centres: (V, 3) of the cameras; longest_ray: of any of them.
        edges: (V, 5, 3) of each camera, directions of which no place in the picture lies on the far side: those of the view and,
            inward, of the picture's four edges.
    """

    cameras: Sequence[Camera]
    frames: Sequence[T]
    centres: Float64 = field(init=False)
    longest_ray: float = field(init=False)
    edges: Float64 = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "centres", centres_of(self.cameras))
        object.__setattr__(self, "longest_ray", max((c.longest_ray for c in self.cameras), default=1.0))
        object.__setattr__(self, "edges", np.stack([_edges(c) for c in self.cameras] or [np.zeros((5, 3))]))

    def near(self, points: Float64, reach: float) -> NDArray[np.int64]:
        """Indices of the frames within ``reach`` of points, see :func:`cameras_near`."""
        return cameras_near(self.centres, points, reach)

    def around(self, points: Float64, reach: float) -> NDArray[np.int64]:
        """Indices, rising, of the frames that may show one of points (N, 3) within ``reach`` of their cameras."""
        near = self.near(points, reach)
        if not len(near):
            return near
        low, high = points.min(axis=0)[None], points.max(axis=0)[None]
        return near[self.may_show(near, low, high, reach)[:, 0]]

    def by_distance(self, candidates: NDArray[np.int64], place: Float64) -> NDArray[np.int64]:
        """Indices of frames, those whose cameras are nearest to a place (3,) first: they most likely show what lies there."""
        apart = np.linalg.norm(self.centres[candidates] - place, axis=1)
        return candidates[np.argsort(apart, kind="stable")]

    def may_show(self, candidates: NDArray[np.int64], low: Float64, high: Float64, reach: float) -> Mask:
        """(N, C) bool, False where a frame surely shows nothing of a box, or nothing within ``reach`` of its camera.

        Args:
            candidates: (N,) frames; low, high: (C, 3) corners of the boxes.
        """
        centres = self.centres[candidates][:, None]
        return _within(centres, low, high, reach) & self.may_look(candidates, low - centres, high - centres)

    def may_look(self, candidates: NDArray[np.int64], low: Float64, high: Float64) -> Mask:
        """(N, C) bool, False where none of the directions in a box lies in a frame's picture.

        Args:
            candidates: (N,) frames; low, high: (1 or N, C, 3) corners of boxes of directions, of any length.
        """
        edges = self.edges[candidates][:, None]
        # The farthest that a box reaches along an edge's normal is at one of its corners.
        farthest = np.where(edges > 0, high[:, :, None] * edges, low[:, :, None] * edges).sum(axis=3)
        inside: Mask = (farthest >= 0).all(axis=2)
        return inside


def _edges(camera: Camera) -> Float64:
    """(5, 3) see :class:`CameraViews`, in world axes."""
    width, height, fx, fy, cx, cy = camera.intrinsics
    normals = np.array([[0, 0, 1], [fx, 0, cx], [-fx, 0, width - cx], [0, fy, cy], [0, -fy, height - cy]])
    return normals @ camera.pose[0]
