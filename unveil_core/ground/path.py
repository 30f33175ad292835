"""Street coordinates (s, t): arc length along the drive's path, and lateral offset from it, positive to the left, as OpenDRIVE
has them.

A street is a surface swept along a path. In these coordinates paint, kerb and sidewalk are nearly constant along s, curves
and slopes included, which makes what is hidden predictable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path_kernels import feet_on_path

__all__ = [
    "EXTENSION_M",
    "SHARPEST_M",
    "StreetPath",
    "first_of_places",
    "fit_path",
    "places_of",
    "prolonged_by",
    "shift_path",
    "travelled",
    "way_of",
]

STEP_M = 0.25
"""Between nodes, metres: a tenth of what is smoothed over, so that headings of neighbouring nodes hardly differ."""
LEAST_MOVE_M = 0.25
"""Frames nearer than this to each other are one place of the way, in their middle: a standing car's poses jitter by millimetres to
centimetres, and a sum of jitter is no way."""
STANDING_M = 0.5
"""A track that never gets farther from its first frame than this stands, and looks along the street."""
SMOOTHED_M = 2.0
"""Standard deviation of the smoothing along the path, metres: about half a car's wheelbase, as its rear axle does."""
END_M = 12.0
"""The heading at either end is that of so much way: a car weaves by a decimetre every 20 m or so. 5 to 15 m were tried on the
sample drives, whose streets are known: 40 m ahead of the last camera the path is 1.3 and 2.0 m off with 5 m, 0.6 and 0.8 m with
12 m."""
BEND_M, LEAST_BEND_M, SHARPEST_M = 30.0, 10.0, 40.0
"""The curvature with which the path is prolonged is that of the last so many metres: with 15 m weaving passes for a bend (6 m off
40 m ahead), 30 and 40 m are alike. With less way than the second it goes on straight, never in a sharper bend than of the
third's radius: a way that bends more has turned a corner, and only what it drove after it tells of the street ahead."""
CORNER_M = 3.0
"""Shortest end of a way that tells the heading after a corner, metres: a car's length of headings."""
FACING = 0.7
"""Cosine of the angle by which a wall that faces the street may be turned from it: 45 degrees."""
EXTENSION_M = 60.0
"""How far the path is prolonged at either end: as far as ground is looked at ahead of the last camera (45 m) and more."""
LOOKUP_CELL_M, LOOKUP_MARGIN_M, LOOKUP_CELLS = 1.0, 30.0, 4_000_000
"""The look-up of nearest nodes: its cell, how far beyond the path it reaches, and how many cells it has at most."""


@dataclass(frozen=True, eq=False)
class StreetPath:
    """The drive's path on the horizontal plane, extended at both ends.

    Attributes:
        axes: (3, 3) rows east, north, up.
        nodes: (S, 2) east/north of the path's nodes, one every ``step``.
        heading: (S,) radians.
        start: arc length of the first node; the first camera is at 0.
        step: metres.
    """

    axes: Float64
    nodes: Float64
    heading: Float64
    start: float
    step: float

    @cached_property
    def travel(self) -> Float64:
        """(S, 2) cosine and sine of the heading: there are far fewer nodes than points that ask for them."""
        return np.stack([np.cos(self.heading), np.sin(self.heading)], axis=1)

    @cached_property
    def lookup(self) -> tuple[Float64, float, NDArray[np.int64]]:
        """A grid that tells where the search for a foot begins: first cell's centre (2,), side of a cell, and index (P, Q) of the
        node nearest to each cell's centre."""
        corner = self.nodes.min(axis=0) - LOOKUP_MARGIN_M
        sides = self.nodes.max(axis=0) + LOOKUP_MARGIN_M - corner
        cell = max(LOOKUP_CELL_M, float(np.sqrt(np.prod(sides) / LOOKUP_CELLS)))
        extent = np.ceil(sides / cell).astype(int) + 1
        centres = np.stack(np.meshgrid(*(np.arange(n) * cell for n in extent), indexing="ij"), axis=-1) + corner
        return corner, cell, cKDTree(self.nodes).query(centres.reshape(-1, 2))[1].reshape(extent)

    def node_of(self, horizontal: Float64) -> NDArray[np.int64]:
        """Index (N,) of the node nearest to points (N, 2)."""
        u = self._foot_of(horizontal)[0]
        return np.clip(np.round(u).astype(np.int64), 0, len(self.nodes) - 1)

    def to_street(self, points: Float64) -> Float64:
        """(N, 3) of arc length, lateral offset (left positive) and height, for world points (N, 3)."""
        local = points @ self.axes.T
        u, aside = self._foot_of(local[:, :2])
        return np.stack([self.start + u * self.step, aside, local[:, 2]], axis=1)

    def _foot_of(self, horizontal: Float64) -> tuple[Float64, Float64]:
        """Nodes and parts of nodes (N,) at the foot of points (N, 2) on the path, and how far to the left of it they lie (N,).

        From the node nearest to the point's cell by Newton's method: beside a bend a metre along the path is less or more than one.
        """
        corner, cell, nearest = self.lookup
        grid = np.round((horizontal - corner) / cell).astype(np.int64)
        index = nearest[np.clip(grid[:, 0], 0, nearest.shape[0] - 1), np.clip(grid[:, 1], 0, nearest.shape[1] - 1)]
        return feet_on_path(
            np.ascontiguousarray(horizontal, dtype=np.float64), index, self.nodes, self.heading, self.step
        )

    def heading_at(self, s: Float64) -> Float64:
        """(N,) radians at arc lengths (N,); beyond the path's ends as there."""
        return np.interp(s, self.start + self.step * np.arange(len(self.heading)), self.heading)

    def along_street(self, s: Float64, vectors: Float64) -> Float64:
        """World vectors (N, 3) as components along the street, to its left and up, at arc lengths (N,)."""
        local = vectors @ self.axes.T
        angle = self._at((s - self.start) / self.step)[1]
        cos, sin = np.cos(angle), np.sin(angle)
        east, north, up = local.T
        return np.stack([east * cos + north * sin, north * cos - east * sin, up], axis=1)

    def faced_by(self, s: Float64, normals: Float64) -> Mask:
        """(N,) whether surfaces with these normals (N, 3), in the world, at arc lengths (N,) face the street, from either side."""
        return np.asarray(np.abs(self.along_street(s, normals)[:, 1]) > FACING)

    def to_world(self, street: Float64) -> Float64:
        """Inverse of :meth:`to_street`."""
        foot, angle = self._at((street[:, 0] - self.start) / self.step)
        east = foot[:, 0] - street[:, 1] * np.sin(angle)
        north = foot[:, 1] + street[:, 1] * np.cos(angle)
        return np.stack([east, north, street[:, 2]], axis=1) @ self.axes

    def _at(self, u: Float64) -> tuple[Float64, Float64]:
        """Place (N, 2) and heading (N,) of the path at nodes and parts of nodes; straight beyond its ends.

        Between nodes both are interpolated: 12 m aside in a bend of 30 m frames of single nodes would be apart by 10 cm.
        """
        index = np.clip(u.astype(np.int64), 0, len(self.nodes) - 2)
        part = u - index
        there, leg = self.nodes[index], self._legs[index]
        return there + part[:, None] * leg, self.heading[index] + np.clip(part, 0, 1) * self._turns[index]

    @cached_property
    def _legs(self) -> Float64:
        return np.diff(self.nodes, axis=0)

    @cached_property
    def _turns(self) -> Float64:
        return np.diff(self.heading)

    def direction_at(self, points: Float64) -> Float64:
        """(N, 3) unit vectors along the street, level, in the world, beside world points (N, 3)."""
        travel = self.travel[self.node_of((points @ self.axes.T)[:, :2])]
        return travel @ self.axes[:2]


def places_of(centres: Float64) -> Float64:
    """The places of a track one after the other: frames less than :data:`LEAST_MOVE_M` from the first of a place are of it.

    Args:
        centres: (F, 2) or (F, 3), in order of travel.
    """
    return np.stack([part.mean(axis=0) for part in np.split(centres, first_of_places(centres)[1:])])


def first_of_places(centres: Float64) -> list[int]:
    """The first frame of each place of a track (F, 2) or (F, 3), see :func:`places_of`."""
    first = [0]
    for i in range(1, len(centres)):
        if np.linalg.norm(centres[i] - centres[first[-1]]) >= LEAST_MOVE_M:
            first.append(i)
    return first


def way_of(centres: Float64) -> float:
    """Metres that a track (F, 3) has gone; a standing car's jitter is no way."""
    return float(travelled(places_of(centres))[-1])


def fit_path(cameras: Sequence[Camera]) -> StreetPath:
    """Smooth the camera centres of one track into a path and prolong it with its curvature at the ends.

    Args:
        cameras: of one track, in order of travel.
    """
    axes = up_frame(UP)
    centres = np.stack([c.centre for c in cameras]) @ axes.T
    way = places_of(centres[:, :2])
    if np.linalg.norm(way - way[0], axis=1).max() < STANDING_M:
        heading = _looking_along(cameras, axes)
        raw, first, last = way[:1], (heading, 0.0), (heading, 0.0)
    else:
        so_far = travelled(way)
        s = np.arange(0.0, so_far[-1], STEP_M)
        raw = np.stack([np.interp(s, so_far, way[:, k]) for k in (0, 1)], axis=1)
        legs = np.diff(raw, axis=0)
        angle = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
        last = _end(angle)
        # Backwards the same curve has the same headings, turned about, and the opposite bend.
        heading, bend = _end(angle[::-1])
        first = heading, -bend
    # What smoothing does to ends it does to the extension's, which are cut off.
    cut = round(4 * SMOOTHED_M / STEP_M)
    count = int(EXTENSION_M / STEP_M)
    behind, ahead = _prolonged(raw[0], *first, -(count + cut)), _prolonged(raw[-1], *last, count + cut)
    nodes = gaussian_filter1d(np.concatenate([behind, raw, ahead]), SMOOTHED_M / STEP_M, axis=0, mode="nearest")
    nodes = nodes[cut : len(nodes) - cut]
    path = _evenly(axes, nodes, -count * STEP_M, STEP_M)
    # Of a way that comes back to its beginning, only that counts.
    early = replace(path, nodes=path.nodes[: 2 * count], heading=path.heading[: 2 * count])
    return replace(path, start=path.start - float(early.to_street(cameras[0].centre[None])[0, 0]))


def _looking_along(cameras: Sequence[Camera], axes: Float64) -> float:
    """Heading of a standing camera: where it looks; where that is straight down, the top of its picture."""
    for directions in ([c.forward for c in cameras], [-c.world_to_camera[1, :3] for c in cameras]):
        east, north, _ = axes @ np.mean(directions, axis=0)
        if np.hypot(east, north) > 0.1:
            return float(np.arctan2(north, east))
    return 0.0


def travelled(nodes: Float64) -> Float64:
    """(N,) way along a line up to each of its nodes (N, 2) or (N, 3), metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])


def _end(angle: Float64) -> tuple[float, float]:
    """Heading at the end of a curve, and its bend there in radians a metre.

    Args:
        angle: (N,) headings of its legs of :data:`STEP_M`, N > 0, the last one at the end.
    """
    count, bend = min(round(BEND_M / STEP_M), len(angle)), 0.0
    if count * STEP_M >= LEAST_BEND_M:
        bend = _bend(angle[-count:])
        while abs(bend) > 1 / SHARPEST_M and count > round(CORNER_M / STEP_M):
            count = max(count // 2, round(CORNER_M / STEP_M))
            bend = _bend(angle[-count:])
        bend = bend if count * STEP_M >= LEAST_BEND_M else 0.0
    part = angle[-min(count, round(END_M / STEP_M)) :]
    away = STEP_M * (np.arange(len(part))[::-1] + 0.5)
    return float(np.mean(part + bend * away)), bend


def _bend(angle: Float64) -> float:
    """Radians a metre by which headings (N,) of legs of :data:`STEP_M` turn."""
    return float(np.polyfit(np.arange(len(angle)) * STEP_M, angle, 1)[0])


def _prolonged(end: Float64, heading: float, bend: float, count: int) -> Float64:
    """(|count|, 2) nodes that follow ``end`` (2,), or, where ``count`` is negative, that come before it, in order."""
    away = np.sign(count) * STEP_M * (np.arange(abs(count)) + 0.5)
    angle = heading + bend * away
    return _walked(end, angle, np.sign(count) * STEP_M)[:: int(np.sign(count))]


def _walked(start: Float64, angle: Float64, step: float) -> Float64:
    """(N, 2) the ends of steps one after the other from ``start`` (2,), with headings (N,)."""
    legs = step * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(start + np.cumsum(legs, axis=0))


def _evenly(axes: Float64, nodes: Float64, start: float, step: float) -> StreetPath:
    """The path through nodes (S, 2) about a step apart."""
    so_far = travelled(nodes)
    even = np.arange(0.0, so_far[-1], step)
    nodes = np.stack([np.interp(even, so_far, nodes[:, k]) for k in (0, 1)], axis=1)
    slope = np.gradient(nodes, step, axis=0)
    return StreetPath(axes, nodes, np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])), start, step)


def shift_path(path: StreetPath, s: Float64, aside: Float64) -> StreetPath:
    """The path moved sideways, so that it keeps its distance from the kerb even where the car did not.

    Args:
        s: (M,) arc lengths, increasing; aside: (M,) how far to the left the path is to lie there, metres; it stays so beyond
            both ends.
    Returns:
        a path whose arc length starts where the other's does.
    """
    at = path.start + path.step * np.arange(len(path.nodes))
    # A heading must not follow each texel by which something was found beside its place.
    offset = gaussian_filter1d(np.interp(at, s, aside), 1.0 / path.step, mode="nearest")
    nodes = path.nodes + offset[:, None] * np.stack([-np.sin(path.heading), np.cos(path.heading)], axis=1)
    return _evenly(path.axes, nodes, path.start, path.step)


def prolonged_by(path: StreetPath, node: int, heading: float, bend: Float64) -> StreetPath:
    """The path up to a node, from where it goes on with other bends, as long as it was.

    Args:
        heading: radians, with which it goes on.
        bend: (M,) radians a metre of its next M steps, after which it is straight.
    """
    count = len(path.nodes) - node - 1
    bend = np.concatenate([bend, np.zeros(max(0, count - len(bend)))])[:count]
    turned = np.cumsum(bend) * path.step
    angle = heading + turned - bend * path.step / 2
    nodes = np.concatenate([path.nodes[: node + 1], _walked(path.nodes[node], angle, path.step)])
    # The joint is smoothed as the way was, which itself is not smoothed again.
    smooth = gaussian_filter1d(nodes, SMOOTHED_M / path.step, axis=0, mode="nearest")
    reach = round(4 * SMOOTHED_M / path.step)
    near = slice(max(0, node - reach), max(0, min(len(nodes) - reach, node + reach)))
    nodes[near] = smooth[near]
    return _evenly(path.axes, nodes, path.start, path.step)
