"""The order of travel of each camera's frames: time stamps rule, then the order that makes a way.

Files list frames in any order: that of threads that worked on them, of names as texts (frame10 before frame2), of a hash table.
What the file says, what the names say, and the way itself are compared; a way is short and does not turn back at each step.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unveil_core.base.checks.numbers_in_names import AS_TEXTS, BY_NUMBERS, name_orders
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.travel.way import Way, along_the_way, way_of

__all__ = ["in_order_of_time", "in_order_of_travel"]

SHORTER = 0.95
"""Another order is taken if its way is shorter by this factor."""
MUCH_SHORTER = 0.7
"""The order along the way, which nothing in the files says, and any order against time stamps: likewise."""
STRAIGHT = 0.15
"""Largest share of steps that turn back in an order that only the places tell: noise around one place has more in any order."""
FEWEST = 4
"""Frames of a camera that have a way."""
FARTHEST = 1e100
"""Coordinates that can be squared."""
STANDS_M = 1.0
"""A camera that stays within so many metres stands: its way is noise."""


@dataclass(frozen=True)
class Order:
    """Attributes:
    by: what the frames go by. indices: of the frames. way: that they then make.
    """

    by: str
    indices: Sequence[int]
    way: Way


Decision = tuple[list[Frame], str | None]
"""The frames of a camera in their order, and what a user should know of it."""


def in_order_of_time(drive: Drive) -> Drive:
    """The drive with each camera's frames by time stamp, where all of them have one; a notice where they were not."""
    return _ordered(drive, _by_time)


def in_order_of_travel(drive: Drive, *, file_order: bool, decides: str) -> Drive:
    """The same for a drive whose files may have any order: where time stamps are missing, or the way contradicts them, each
    camera's frames are in the order that makes a way.

    Args:
        file_order: whether the file means the order in which the reader gave the frames, which then stays unless another one is
            better; else names come first.
        decides: what a user may give instead, for notices.
    """
    least = STANDS_M * drive.units_per_metre if drive.units_per_metre is not None else 0.0
    return _ordered(drive, lambda track: _by_way(track, file_order, least, decides))


def _ordered(drive: Drive, decide: Callable[[list[Frame]], Decision]) -> Drive:
    ordered: list[Frame] = []
    notices: list[str] = []
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    for name in names:
        track, told = decide([f for f in drive.frames if f.camera_name == name])
        ordered += track
        notices += [f"camera {name}: {told}" if len(names) > 1 else told] if told else []
    return replace(drive, frames=tuple(ordered), notices=(*drive.notices, *notices))


def _by_time(track: list[Frame]) -> Decision:
    if any(f.timestamp is None for f in track):
        return track, None
    by_time = sorted(track, key=lambda f: f.timestamp or 0.0)
    if all(a is b for a, b in zip(track, by_time, strict=True)):
        return track, None
    return by_time, "time stamps are not in the order of the frames; frames are taken by time"


def _by_way(track: list[Frame], file_order: bool, least_extent: float, decides: str) -> Decision:
    centres = np.stack([f.camera.centre for f in track])
    if len(track) < FEWEST or not (np.abs(centres) < FARTHEST).all():
        by = _orders(track, centres, file_order)[0].indices
        return _by_time([track[i] for i in by])
    orders = _orders(track, centres, file_order)
    best = _shortest(orders)
    stamps = [f.timestamp for f in track if f.timestamp is not None]
    stands = best.way.extent <= least_extent
    if len(stamps) == len(track) and min(stamps) < max(stamps):
        in_time = sorted(range(len(track)), key=lambda i: track[i].timestamp or 0.0)
        way = way_of(centres[in_time])
        if stands or not way.zigzags:
            return _by_time(track)
        straight = _along(track, centres) if best.way.zigzags else None
        found = straight or best
        if found.way.length >= MUCH_SHORTER * way.length:
            frames, _ = _by_time(track)
            return frames, _no_way("their time stamps", way, decides)
        told = f"time stamps do not follow the way and are not used: frames are taken in the order of {found.by}"
        return [replace(track[i], timestamp=None) for i in found.indices], told
    if best.way.zigzags and not stands:
        straight = _along(track, centres)
        if straight is not None and straight.way.length < MUCH_SHORTER * best.way.length:
            told = (
                f"frames are taken as they lie along the way: in the order of {best.by} it is {_times(best, straight)} times as "
                f"long, to and fro; {decides} decides"
            )
            return _untimed([track[i] for i in straight.indices], stamps, told)
        return _untimed([track[i] for i in best.indices], stamps, _no_way(best.by, best.way, decides))
    return _untimed([track[i] for i in best.indices], stamps, _told(best, orders, decides))


def _orders(track: Sequence[Frame], centres: Float64, file_order: bool) -> list[Order]:
    """What the file and the names say, the likelier first. Of pictures in several folders the folders count, too."""
    paths = name_orders(_paths_within([f.image_path for f in track]))
    # Parts of one sequence may lie in several folders, as those to train and to test; sequences of their own have equal names.
    bare = [f.image_path.stem for f in track]
    stems = name_orders(bare) if len(set(bare)) == len(bare) and len({f.image_path.parent for f in track}) > 1 else []
    names = paths + [(f"{by}, without their folders", order) for by, order in stems]
    file = [("the file", list(range(len(track))))]
    return [Order(by, order, way_of(centres[order])) for by, order in (file + names if file_order else names + file)]


def _paths_within(images: Sequence[Path]) -> list[str]:
    """Paths without suffixes within the folder that holds all pictures: what it lies in tells nothing."""
    whole = [os.path.splitext(p)[0] for p in images]
    try:
        shared = os.path.commonpath({os.path.dirname(p) for p in whole})
    except ValueError:  # on several disks, or of several kinds
        shared = ""
    return [p.removeprefix(shared).lstrip(os.sep).replace(os.sep, "/") for p in whole]


def _along(track: Sequence[Frame], centres: Float64) -> Order | None:
    """The order in which the frames lie along a way; None where they lie along none."""
    found = along_the_way(centres, np.stack([f.camera.forward for f in track]))
    way = None if found is None else way_of(centres[found])
    if found is None or way is None or way.turning_back > STRAIGHT:
        return None
    return Order("their places along it", found.tolist(), way)


def _shortest(orders: Sequence[Order]) -> Order:
    """The one with the shortest way; an earlier one unless a later one's is clearly shorter."""
    least = min(o.way.length for o in orders)
    return next(o for o in orders if o.way.length * SHORTER <= least)


def _untimed(frames: list[Frame], stamps: Sequence[float], told: str | None) -> Decision:
    """Frames of which not all have time stamps, or all the same: these say nothing."""
    if not stamps:
        return frames, told
    some = f"only {len(stamps)} of {len(frames)} frames have a time stamp" if len(stamps) < len(frames) else None
    said = f"{some or 'all frames have one time stamp'}: these do not order them"
    same = [f if some else replace(f, timestamp=None) for f in frames]
    return same, said if told is None else f"{told}; {said}"


def _no_way(by: str, way: Way, decides: str) -> str:
    back = f"{way.turning_back:.0%} of the steps lead back"
    return f"no order of the frames makes a way: in that of {by} {back}; {decides} decides, and camera, if there are several"


def _told(best: Order, orders: Sequence[Order], decides: str) -> str | None:
    first = orders[0]
    if best is not first:
        to_and_fro = ", to and fro" if first.way.zigzags else ""
        longer = f"in that of {first.by} the way is {_times(first, best)} times as long{to_and_fro}"
        return f"frames are taken in the order of {best.by}: {longer}; {decides} decides"
    as_texts = next((o for o in orders if o.by == AS_TEXTS), None)
    if best.by == BY_NUMBERS and as_texts is not None and as_texts.way.length * SHORTER > best.way.length:
        return f"frames are taken by {best.by}: as texts, the way is {_times(as_texts, best)} times as long"
    return None


def _times(longer: Order, shorter: Order) -> str:
    return f"{longer.way.length / shorter.way.length:.1f}" if shorter.way.length > 0 else "many"
