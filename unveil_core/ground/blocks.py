"""A long drive cut into blocks along its way: each is reconstructed, filled and repeated alone.

A block owns the frames that were taken in it and the places beside it; nothing belongs to two. Frames of its neighbours that look
into it join it for the work, so that what lies at its ends is seen as well as what lies in its middle.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Labels
from unveil_core.drives.drive import Drive, instants
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.path import first_of_places, travelled
from unveil_core.ground.track import longest_track

__all__ = ["BLOCK_M", "Block", "Blocks", "block_name", "cut_into_blocks"]

BLOCK_M = 100.0
"""Length of a block, metres, about: as far as a frame looks ahead. Shorter ones would see more of their neighbours than of
themselves."""
LOOKS_M = (5.0, 10.0, 15.0, 20.0)
"""Depths at which it is asked what a frame looks at, metres: nearer than that other frames show the same better, and what is
farther off fills few pixels."""
NODE_M = 1.0
"""Distance between nodes of the way by which places are found, metres."""
SAME_M = 1.5
"""Where the way comes by again this near, places belong to the first time, metres: a lane's half width."""
AT_ONCE = 65_536
"""Places that are asked for at a time: 200 bytes each."""
NODES_ASKED = 8
"""Nearest nodes that are compared: those of two passes."""


@dataclass(frozen=True)
class Block:
    """A stretch of the way.

    Attributes:
        number: from 0, in order of travel.
        own: indices of the frames taken in it.
        frames: of these and of the frames of other blocks that look into it, in the drive's order.
    """

    number: int
    own: tuple[int, ...]
    frames: tuple[int, ...]

    @property
    def name(self) -> str:
        """For files."""
        return block_name(self.number)


def block_name(number: int) -> str:
    """Of a block, for files."""
    return f"{number:04d}"


@dataclass(frozen=True, eq=False)
class Blocks:
    """All blocks of a drive.

    Attributes:
        blocks: in order of travel, one at least.
        nodes: (M, 2) places of the way on the horizontal plane; of_node: (M,) the block that each lies in.
    """

    blocks: tuple[Block, ...]
    nodes: Float64
    of_node: Labels
    _tree: cKDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tree", cKDTree(self.nodes))

    def of_places(self, places: Float64) -> Labels:
        """(N,) the block that owns each world place (N, 3): that of the nearest piece of the way."""
        if len(self.blocks) == 1 or not len(places):
            return np.zeros(len(places), dtype=np.int64)
        owners = np.empty(len(places), dtype=np.int64)
        for first in range(0, len(places), AT_ONCE):
            owners[first : first + AT_ONCE] = self._of_some(places[first : first + AT_ONCE])
        return owners

    def _of_some(self, places: Float64) -> Labels:
        horizontal = (places @ up_frame(UP).T)[:, :2]
        apart, nearest = self._tree.query(horizontal, k=min(NODES_ASKED, len(self.nodes)))
        block = np.where(apart <= apart[:, :1] + SAME_M, self.of_node[nearest], len(self.blocks))
        # At the border of two blocks the nearer node counts; only where the way comes by again, much earlier, the earlier.
        first = self.of_node[nearest[:, 0]]
        earlier = block.min(axis=1)
        return np.where(earlier < first - 1, earlier, first).astype(np.int64)


def cut_into_blocks(drive: Drive, length_m: float | None = None) -> Blocks:
    """Cut a drive into blocks of about ``length_m`` metres of way; a shorter drive, and one that stands, is one block.

    Args:
        drive: an imported drive.
        length_m: :data:`BLOCK_M` by default.
    """
    track = longest_track(drive)
    frames = drive.frames
    horizontal = (centres_of([f.camera for f in frames]) @ up_frame(UP).T)[:, :2]
    places, station = _stations(horizontal[track])
    times = instants(frames)
    order = np.argsort(times[track], kind="stable")
    of_frame = np.interp(times, times[track][order], station[order])
    way = float(station.max())
    count = max(1, round(way / (length_m or BLOCK_M)))
    nodes, at = _nodes(places)
    of_node = _number(at, way, count)
    own = _number(of_frame, way, count)
    blocks = Blocks(tuple(Block(k, (), ()) for k in range(count)), nodes, of_node)
    joined = np.zeros((len(frames), count), dtype=bool)
    joined[np.arange(len(frames)), own] = True
    for depth in LOOKS_M:
        looks = np.stack([f.camera.centre + depth * f.camera.forward for f in frames])
        joined[np.arange(len(frames)), blocks.of_places(looks)] = True
    found = [
        Block(k, tuple(np.flatnonzero(own == k).tolist()), tuple(np.flatnonzero(joined[:, k]).tolist()))
        for k in range(count)
    ]
    return Blocks(tuple(found), nodes, of_node)


def _number(station: Float64, way: float, count: int) -> Labels:
    """(N,) the block of arc lengths (N,)."""
    share = station / way if way > 0 else np.zeros_like(station)
    return np.clip((share * count).astype(np.int64), 0, count - 1)


def _stations(centres: Float64) -> tuple[Float64, Float64]:
    """(P, 2) places of a track (F, 2), each at least ``LEAST_MOVE_M`` from the last, and (F,) way up to each of its frames."""
    first = first_of_places(centres)
    places = centres[first]
    of_frame = np.searchsorted(first, np.arange(len(centres)), side="right") - 1
    return places, travelled(places)[of_frame]


def _nodes(places: Float64) -> tuple[Float64, Float64]:
    """(M, 2) nodes along the line through places (P, 2), and (M,) the way up to each."""
    way = travelled(places)
    at = np.linspace(0.0, way[-1], max(1, int(np.ceil(way[-1] / NODE_M))) + 1)
    return np.stack([np.interp(at, way, places[:, k]) for k in (0, 1)], axis=1), at
