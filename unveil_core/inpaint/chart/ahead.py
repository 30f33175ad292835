"""Where the street goes on ahead of the last camera: along what its frames show of it.

A path that is prolonged as the car drove is metres off after 30 m: in a bend that begins or ends, and after a corner, which a car
leaves aslant. What is seen ahead tells: along the true street each lateral offset stays what it is, road, sidewalk or wall, and
paint and kerbs stay where they are. Of all smooth ways on that is the best which keeps its cross section longest, sought by beam
search, as roads are followed in pictures from the air (Vosselman and Knecht, *Road tracing by profile matching and Kalman
filtering*, 1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.path import SHARPEST_M, StreetPath, prolonged_by
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.plan_view import UNKNOWN, PlanView, read_plan

__all__ = ["follow_street", "path_ahead"]

PIECE_M = 4.0
"""Length of way that has one bend, metres: half of what a road takes to turn from straight to its bend."""
AHEAD_M = 44.0
"""How far the street is followed, metres: as far as views are read."""
BEFORE_M = 24.0
"""Length of driven way whose cross section is looked for ahead, metres."""
FADING = 0.85
"""What is left of a piece's say in the cross section after each further piece: streets change within 25 m."""
HALF_M = 12.0
"""Half the width of the cross section, metres: two lanes, the parked cars, a sidewalk and the foot of the houses."""
ROW_M, OFFSET_M = 0.5, 0.2
"""Distances of the places that are compared, along the way and across."""
SURE = 4.0
"""Rows that must have shown an offset for it to have its full say."""
LINE = 4.8
"""Square metres of one kind that a square metre of the same line is worth: kinds tell only at their borders."""
BENDS = np.array([0, 1 / 300, -1 / 300, 1 / 120, -1 / 120, 1 / 60, -1 / 60])
"""Changes of the bend from one piece to the next that are tried, radians a metre."""
BEND_COST = 480.0
"""Square metres that a change of the bend by 1 radian a metre must gain: 4 for one to a radius of 120 m."""
TURNS, TURN_COST = np.radians(np.arange(-15, 15.1, 1)), 60.0
"""Turns that are tried at the end of a way with a heading, and the square metres that a radian of them must gain: a car weaves by
a degree or two, and where a bend has just ended the heading that is prolonged is 10 degrees off. Nine drawn streets are followed
as well with 14, but a real one, of which 12 m were driven and where cars pass, turned by 8 degrees and back."""
LEAST_WAY_M = 12.0
"""A way that has gone less since it turned a corner has no heading yet, metres."""
CORNER_TURNS, CORNER_COST = np.radians(np.arange(-45, 45.1, 1.5)), 2.3
"""The same for a way without."""
TIGHTEST_M = 30.0
"""Radius of the tightest bend that is followed, metres: tighter ones are corners, at which another street begins."""
BEAM = 300
"""Ways that are followed at once; with 150 one of 12 streets was lost."""
SAME_M, SAME_TURN, SAME_BEND = 0.4, np.radians(2.0), 1 / 150
"""Ways that come so near to each other, with headings and bends so alike, are one: the better one is followed."""
BESIDE_M = 26.0
"""How far beside the prolonged path the ground is read, metres: at the tightest bend AHEAD_M lead as far aside."""


@dataclass(frozen=True, eq=False)
class _Section:
    """What N ways have shown of T lateral offsets.

    Attributes:
        kinds: (N, T, K) rows that were of each kind; lines: (N, T) sum of their lines; rows: (N, T) rows that showed ground.
    """

    kinds: Float32
    lines: Float32
    rows: Float32

    def of(self, ways: NDArray[np.int64]) -> _Section:
        """Those of some ways."""
        return _Section(self.kinds[ways], self.lines[ways], self.rows[ways])

    def followed_by(self, other: _Section) -> _Section:
        """With the next piece's, before which these fade."""
        return _Section(
            FADING * self.kinds + other.kinds, FADING * self.lines + other.lines, FADING * self.rows + other.rows
        )

    def agreement(self, other: _Section) -> Float64:
        """(N,) square metres of ``other`` that are what these tell, half less those that are not."""
        many = self.kinds.sum(axis=2)
        share = self.kinds / np.maximum(many, 1e-3)[..., None]
        kinds = ((share * other.kinds).sum(axis=2) - 0.5 * other.kinds.sum(axis=2)) * np.minimum(many / SURE, 1)
        lines = self.lines / np.maximum(self.rows, 1e-3) * other.lines * np.minimum(self.rows / SURE, 1)
        found: Float64 = (kinds + 0.5 * LINE * lines).sum(axis=1) * (ROW_M * OFFSET_M)
        return found


@dataclass(frozen=True, eq=False)
class _Ways:
    """Ways that are followed.

    Attributes:
        place: (N, 2) their ends, east and north; heading, bend: (N,) there; gain: (N,) square metres so far.
        section: what they have shown.
        begun: (N,) the headings that they began with; bends: (N, M) of their pieces.
    """

    place: Float64
    heading: Float64
    bend: Float64
    gain: Float64
    section: _Section
    begun: Float64
    bends: Float64


def path_ahead(
    ground: Ground,
    track: Sequence[Camera],
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    usable: Sequence[Mask],
    *,
    kinds: Sequence[int],
    walls: Float64,
) -> StreetPath:
    """The ground's path, prolonged along the street that is seen ahead.

    Args:
        track: the cameras that drove it.
        cameras, images, labels, usable: of all frames, see :func:`unveil_core.inpaint.chart.street_chart.read_chart`.
        kinds: labels of ground that are told apart.
        walls: (W, 3) places of what bounds the ground.
    """
    path = ground.path
    end = float(path.to_street(centres_of(track)).max(axis=0)[0])
    s = path.start + path.step * np.arange(len(path.nodes))
    around = path.nodes[(s > end - BEFORE_M) & (s < end + AHEAD_M)]
    low, high = around.min(axis=0) - BESIDE_M, around.max(axis=0) + BESIDE_M
    view = read_plan(ground, low, high, cameras, images, labels, usable, kinds=kinds, walls=walls)
    return follow_street(path, end, view)


def follow_street(path: StreetPath, end: float, view: PlanView) -> StreetPath:
    """A path that goes on from arc length ``end`` along the street that a view from above shows."""
    ways, at = _beginnings(path, end, view)
    for _ in range(round(AHEAD_M / PIECE_M)):
        ways = _further(ways, view)
    best = int(np.argmax(ways.gain))
    return prolonged_by(path, at, float(ways.begun[best]), np.repeat(ways.bends[best], round(PIECE_M / path.step)))


def _beginnings(path: StreetPath, end: float, view: PlanView) -> tuple[_Ways, int]:
    """The ways that begin at a path's end, which it has at the node that is returned."""
    at = round((end - path.start) / path.step)
    piece = round(PIECE_M / path.step)
    first = max(round(-path.start / path.step), at - round(BEFORE_M / path.step), 0)
    turning = np.abs(np.gradient(path.heading, path.step))
    sharp = np.flatnonzero(turning[first:at] > 1 / TIGHTEST_M)
    first += int(sharp[-1]) + 1 if len(sharp) else 0
    section = None
    for start in range(at - (at - first) // piece * piece, at, piece):
        bend = (path.heading[start + piece] - path.heading[start]) / PIECE_M
        one = np.array([start])
        shown = _shown(view, path.nodes[one], path.heading[one], np.array([bend]))
        section = shown if section is None else section.followed_by(shown)
    count = round(2 * HALF_M / OFFSET_M) + 1
    if section is None:
        nothing = np.zeros((1, count), dtype=np.float32)
        section = _Section(np.zeros((1, count, view.count), dtype=np.float32), nothing, nothing)
    steady = (at - first) * path.step >= LEAST_WAY_M
    turns, cost = (TURNS, TURN_COST) if steady else (CORNER_TURNS, CORNER_COST)
    same = np.zeros(len(turns), dtype=np.int64)
    heading = path.heading[at] + turns
    # As the path goes on by itself, once its corner is smoothed.
    bend = np.clip((path.heading[at + 2 * piece] - path.heading[at + piece]) / PIECE_M, -1 / SHARPEST_M, 1 / SHARPEST_M)
    ways = _Ways(
        path.nodes[at + same],
        heading,
        np.full(len(turns), bend),
        -cost * np.abs(turns),
        section.of(same),
        heading,
        np.zeros((len(turns), 0)),
    )
    return ways, at


def _further(ways: _Ways, view: PlanView) -> _Ways:
    """The best ways that are a piece longer."""
    parent = np.repeat(np.arange(len(ways.gain)), len(BENDS))
    change = np.tile(BENDS, len(ways.gain))
    bend = ways.bend[parent] + change
    possible = np.abs(bend) <= 1 / TIGHTEST_M
    parent, change, bend = parent[possible], change[possible], bend[possible]
    place, heading = ways.place[parent], ways.heading[parent]
    shown = _shown(view, place, heading, bend)
    gain = ways.gain[parent] + ways.section.of(parent).agreement(shown) - BEND_COST * np.abs(change)
    place = place + PIECE_M * _unit(heading + bend * PIECE_M / 2)
    heading = heading + bend * PIECE_M
    order = np.argsort(-gain, kind="stable")
    alike = np.column_stack([place / SAME_M, heading / SAME_TURN, bend / SAME_BEND])[order]
    first = np.sort(np.unique(np.rint(alike), axis=0, return_index=True)[1])
    kept = order[first[:BEAM]]
    parent = parent[kept]
    return _Ways(
        place[kept],
        heading[kept],
        bend[kept],
        gain[kept],
        ways.section.of(parent).followed_by(shown.of(kept)),
        ways.begun[parent],
        np.column_stack([ways.bends[parent], bend[kept]]),
    )


def _shown(view: PlanView, place: Float64, heading: Float64, bend: Float64) -> _Section:
    """What pieces of way show that begin at places (N, 2) with headings and bends (N,)."""
    along = np.arange(ROW_M / 2, PIECE_M, ROW_M)
    across = np.arange(-HALF_M, HALF_M + OFFSET_M / 2, OFFSET_M)
    foot: Float64 = place[:, None] + along[:, None] * _unit(heading[:, None] + bend[:, None] * along / 2)
    left: Float64 = _unit(heading[:, None] + bend[:, None] * along + np.pi / 2)
    places: Float64 = foot[:, :, None] + left[:, :, None] * across[:, None]
    kind, line = view.at(places)
    kinds = np.stack([(kind == k).sum(axis=1) for k in range(view.count)], axis=2).astype(np.float32)
    ground = (kind != UNKNOWN) & (kind != view.count - 1)
    return _Section(
        kinds, np.where(ground, line, 0).sum(axis=1, dtype=np.float32), ground.sum(axis=1).astype(np.float32)
    )


def _unit(angle: Float64) -> Float64:
    """(..., 2) unit vectors."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
