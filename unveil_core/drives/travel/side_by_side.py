"""Whether two groups of pictures are those of two cameras of a rig, or of one camera.

Cameras of a rig are on their way at the same time and keep their distance and angle to each other. One camera's pictures are before
each other, or between each other on one path, however many folders or focal lengths they have. Neither folders nor lenses decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64

__all__ = ["APART", "RIG", "SAME", "Group", "is_smooth", "relation", "roughness"]

RIG, SAME, APART = "rig", "same", "apart"
"""Two cameras that are mounted together; one camera; two that have nothing to do with each other."""
NEITHER = "neither"
MOST_COMPARED = 200
"""Pictures of a group that are compared with another one."""
FEWEST = 3
"""Pictures that must be comparable for anything to be said of their motion."""
NEAR_FOCAL = 0.15
"""Focal lengths that differ by a smaller share may be one lens': autofocus changes them by some percent."""
OVERLAP = 0.2
"""Groups that share a smaller part of the shorter one's time, or way, follow each other."""
STEADY = 0.1
"""What two mounted cameras' distance may vary by: so much of itself, and of a step; poses are noisy, time stamps late."""
STEADY_DEG = 4.0
NOTICEABLE, NOTICEABLE_DEG = 0.02, 2.0
"""Distances and angles between pictures that are more than one camera's noise on one path: a share of a step, and degrees."""
CERTAIN = 4.0
"""They are also so many times their own uncertainty."""
CLEARER = 4.0
"""Where nothing but motion speaks for two cameras, all of these are so many times larger."""


@dataclass(frozen=True, eq=False)
class Group:
    """Pictures in the order of their names or time stamps.

    Attributes:
        centres: (N, 3); rotations: (N, 3, 3) camera-to-world.
        clock: (N,) when each was taken, ascending: time stamps, or the numbers in their names; None where there are neither.
        size: width and height, pixels; focal: pixels, the median.
        moments: names of its pictures without what tells the groups apart: a rig's cameras share them.
    """

    centres: Float64
    rotations: Float64
    clock: Float64 | None
    size: tuple[int, int]
    focal: float
    moments: frozenset[str]

    @cached_property
    def step(self) -> float:
        """The median way between two pictures that follow each other."""
        steps = np.linalg.norm(np.diff(self.centres, axis=0), axis=1)
        return float(np.median(steps)) if len(steps) else 0.0

    @cached_property
    def heading(self) -> Float64:
        """(3,) unit: the median direction of motion in the camera's own axes; zero where it stands."""
        steps = np.diff(self.centres, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        moved = lengths > 0
        own = np.einsum("nji,nj->ni", self.rotations[:-1][moved], steps[moved] / lengths[moved, None])
        middle = np.median(own, axis=0) if len(own) else np.zeros(3)
        length = float(np.linalg.norm(middle))
        return middle / length if length > 0.5 else np.zeros(3)

    def has_lens_of(self, other: Group) -> bool:
        """Whether one lens may have taken both."""
        return self.size == other.size and abs(np.log(self.focal / other.focal)) < NEAR_FOCAL


def is_smooth(centres: Float64, rotations: Float64) -> bool:
    """Whether places (N, 3) and turns (N, 3, 3) are those of one camera for certain: each picture amid those beside it."""
    if len(centres) < FEWEST:
        return False
    with np.errstate(all="ignore"):
        beside = centres[2:] - centres[:-2]
        off = np.linalg.norm(centres[1:-1] - centres[:-2] - 0.5 * beside, axis=1)
        turned = _degrees(np.einsum("nji,njk->nik", rotations[:-1], rotations[1:]))
        # Of cameras in a row that take turns only the outer ones are off.
        far, wide = np.quantile(off, 0.75), np.quantile(turned, 0.75)
        return bool(far < 2.5 * NOTICEABLE * np.median(np.linalg.norm(beside, axis=1)) and wide < 2 * NOTICEABLE_DEG)


def roughness(centres: Float64, rotations: Float64, every: int) -> float:
    """How far each ``every``-th of places (N, 3) and turns (N, 3, 3) is from a smooth way; of a smooth one about the same for all
    numbers."""
    with np.errstate(all="ignore"):
        bend = centres[2 * every :] - 2 * centres[every:-every] + centres[: -2 * every]
        turned = _degrees(np.einsum("nji,njk->nik", rotations[:-every], rotations[every:]))
        step = np.median(np.linalg.norm(centres[every:] - centres[:-every], axis=1)) / every
        off = np.median(np.linalg.norm(bend, axis=1)) / every**2
        return float(np.nan_to_num(off / step if step > 0 else 0.0) + np.mean(turned) / every / STEADY_DEG)


def relation(a: Group, b: Group, *, timed: bool, clear: bool = False, zooms: bool = False) -> str:
    """Of two groups: :data:`RIG`, :data:`SAME` or :data:`APART`.

    Args:
        timed: whether the clocks are time stamps, which tell for sure who was on the way when; numbers in names may begin anew.
        clear: whether a rig has to be a clear case, because nothing but motion speaks for one.
        zooms: whether groups that follow each other are one camera's whatever their focal lengths are, because nothing else tells
            them apart.
    """
    noticeable = CLEARER if clear else 1.0
    one = SAME if a.has_lens_of(b) or (zooms and a.size == b.size) else APART
    if min(len(a.centres), len(b.centres)) < FEWEST:
        return RIG if len(a.moments & b.moments) == min(len(a.moments), len(b.moments)) else one
    with np.errstate(all="ignore"):
        if a.clock is not None and b.clock is not None:
            known = _by_clock(a, b, timed, noticeable, one)
            if known is not None:
                return known
            if len(np.intersect1d(a.clock, b.clock)) and not _follow_each_other(a, b):
                # Numbers begin anew, and so does the way: another drive through the street, unless it is a rig.
                return _by_places(a, b, noticeable, one, beside=APART)
        return _by_places(a, b, noticeable, one, beside=one)


def _by_clock(a: Group, b: Group, timed: bool, noticeable: float, one: str) -> str | None:
    """By where both are at the same time; None where the clock is none.

    Args:
        one: what they are if they follow each other.
    """
    assert a.clock is not None and b.clock is not None
    begin, end = max(a.clock[0], b.clock[0]), min(a.clock[-1], b.clock[-1])
    shorter = min(np.ptp(a.clock), np.ptp(b.clock))
    if end - begin < OVERLAP * shorter or end <= begin:
        return one if timed else None
    few, many = (a, b) if len(a.centres) <= len(b.centres) else (b, a)
    assert few.clock is not None and many.clock is not None
    both = np.flatnonzero((few.clock >= many.clock[0]) & (few.clock <= many.clock[-1]))
    both = both[:: -(-len(both) // MOST_COMPARED)] if len(both) else both
    if len(both) < FEWEST:
        return one if timed else None
    centres, rotations = _at(many, few.clock[both])
    shared = len(np.intersect1d(a.clock, b.clock)) * 2 >= min(len(a.clock), len(b.clock))
    found = _compared(few, both, centres, rotations, along_counts=timed or shared, times=noticeable)
    if timed and found == NEITHER:
        return SAME if a.has_lens_of(b) and _between(a, b) else APART
    begins_anew = not timed and (_follow_each_other(a, b) if found == RIG else shared)
    if found == NEITHER or begins_anew:
        return None  # numbers that begin anew in the next folder: one camera has no two pictures of a number
    return RIG if found == RIG or not a.has_lens_of(b) else SAME


def _by_places(a: Group, b: Group, noticeable: float, one: str, beside: str) -> str:
    """By where one is beside the other's path.

    Args:
        one: what they are if they follow each other; beside: if they are beside each other, but no rig.
    """
    few, many = (a, b) if len(a.centres) <= len(b.centres) else (b, a)
    some = np.arange(len(few.centres))[:: -(-len(few.centres) // MOST_COMPARED)]
    place, inside = _nearest_on_path(few.centres[some], many.centres)
    if inside.mean() < OVERLAP or inside.sum() < FEWEST:
        return one
    some, place = some[inside], place[inside]
    centres, rotations = _between_pictures(many, place)
    found = _compared(few, some, centres, rotations, along_counts=False, times=noticeable)
    if found == RIG:
        # Who comes back on the other side of the street keeps his distance, too, but goes the other way.
        return RIG if float(np.median(np.diff(place))) > 0 else beside
    return RIG if found == SAME and not a.has_lens_of(b) else beside


def _compared(
    few: Group, some: NDArray[np.int64], centres: Float64, rotations: Float64, *, along_counts: bool, times: float
) -> str:
    """Whether pictures of a group keep a distance or an angle to places of another's path: :data:`RIG`; neither is noticeable:
    :data:`SAME`; or neither of both, where they vary: :data:`NEITHER`.

    Args:
        some: (M,) pictures of the group; centres: (M, 3), rotations: (M, 3, 3) of the other there.
        along_counts: whether a distance along the way is one; else it may come of pictures between pictures.
        times: so much clearer must a rig be than noise.
    """
    own = few.rotations[some]
    offsets = np.einsum("nji,nj->ni", own, centres - few.centres[some])
    turned = np.einsum("nji,njk->nik", own, rotations)
    middle, turn = np.median(offsets, axis=0), _mean_rotation(turned)
    spread = 1.48 * float(np.median(np.linalg.norm(offsets - middle, axis=1)))
    angles = _degrees(np.einsum("ji,njk->nik", turn, turned))
    spread_deg = float(np.median(angles))
    across = middle if along_counts else middle - (middle @ few.heading) * few.heading
    far, angle = float(np.linalg.norm(across)), float(_degrees(turn[None])[0])
    step, root = few.step, np.sqrt(len(some))
    steady = spread <= STEADY * (step + np.linalg.norm(middle)) and spread_deg <= STEADY_DEG
    shifted = far > times * max(NOTICEABLE * step, CERTAIN * spread / root)
    swung = angle > times * max(NOTICEABLE_DEG, CERTAIN * spread_deg / root)
    if steady and (shifted or swung):
        return RIG
    return SAME if far <= max(0.5 * step, CERTAIN * spread / root) and angle <= 3 * STEADY_DEG else NEITHER


def _between(a: Group, b: Group) -> bool:
    """Whether the pictures of two groups are between each other on one path."""
    place, inside = _nearest_on_path(a.centres[:: -(-len(a.centres) // MOST_COMPARED)], b.centres)
    at, _ = _between_pictures(b, place[inside])
    far = np.linalg.norm(a.centres[:: -(-len(a.centres) // MOST_COMPARED)][inside] - at, axis=1)
    return bool(len(far) >= FEWEST and np.median(far) <= NOTICEABLE * 5 * max(a.step, b.step))


def _follow_each_other(a: Group, b: Group) -> bool:
    """Whether one's way begins where the other's ends, farther on than vehicles are long."""
    step = max(a.step, b.step)
    lengths = [float(np.linalg.norm(np.diff(g.centres, axis=0), axis=1).sum()) for g in (a, b)]
    for first, then, length in ((a, b, lengths[0]), (b, a, lengths[1])):
        gap = float(np.linalg.norm(then.centres[0] - first.centres[-1]))
        if gap <= 3 * step and length > 3 * step:
            return True
    return False


def _at(group: Group, times: Float64) -> tuple[Float64, Float64]:
    """Where a group's camera is at times within its own: (M, 3) by a cubic through the pictures around, (M, 3, 3)."""
    clock = group.clock
    assert clock is not None
    k = np.clip(np.searchsorted(clock, times, side="right") - 1, 0, len(clock) - 2)
    width = clock[k + 1] - clock[k]
    share = np.where(width > 0, (times - clock[k]) / np.where(width > 0, width, 1), 0.0)
    slopes = np.gradient(group.centres, _distinct(clock), axis=0)
    u, h = share[:, None], width[:, None]
    p, q, m, n = group.centres[k], group.centres[k + 1], slopes[k], slopes[k + 1]
    places = (1 + 2 * u) * (1 - u) ** 2 * p + u * (1 - u) ** 2 * h * m + u**2 * (3 - 2 * u) * q + u**2 * (u - 1) * h * n
    return places, _blended(group.rotations[k], group.rotations[k + 1], share)


def _distinct(clock: Float64) -> Float64:
    """Ascending times without equal ones, as finite differences need them."""
    least = 1e-9 * max(1.0, float(np.ptp(clock)))
    return clock + least * np.arange(len(clock)) if (np.diff(clock) <= 0).any() else clock


def _between_pictures(group: Group, place: Float64) -> tuple[Float64, Float64]:
    """The path of a group at places, counted in its pictures: (M, 3) and (M, 3, 3)."""
    numbered = Group(
        group.centres,
        group.rotations,
        np.arange(len(group.centres), dtype=np.float64),
        group.size,
        group.focal,
        group.moments,
    )
    return _at(numbered, place)


def _nearest_on_path(points: Float64, path: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """(M,) the nearest places on the straight pieces of a path, counted in its points, and whether they are not its ends."""
    start, along = path[:-1], np.diff(path, axis=0)
    square = np.einsum("ij,ij->i", along, along)
    to = points[:, None] - start[None]
    share = np.clip(np.einsum("mij,ij->mi", to, along) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    far = np.linalg.norm(to - share[..., None] * along, axis=2)
    piece = far.argmin(axis=1)
    place = piece + share[np.arange(len(points)), piece]
    return place, (place > 0) & (place < len(path) - 1)


def _blended(before: Float64, after: Float64, share: Float64) -> Float64:
    """(M, 3, 3) rotations between two."""
    return _rotations((1 - share)[:, None, None] * before + share[:, None, None] * after)


def _rotations(matrices: Float64) -> Float64:
    """(M, 3, 3) the nearest rotations."""
    u, _, v = np.linalg.svd(np.nan_to_num(matrices))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return u @ v


def _mean_rotation(rotations: Float64) -> Float64:
    """(3, 3): first of all, then of those that are near: some may be far off."""
    mean = _rotations(rotations.mean(axis=0)[None])[0]
    near = _degrees(np.einsum("ji,njk->nik", mean, rotations))
    kept = rotations[near <= 2 * np.median(near) + 1e-9]
    return _rotations(kept.mean(axis=0)[None])[0] if len(kept) else mean


def _degrees(rotations: Float64) -> Float64:
    """(M,) angles of rotations (M, 3, 3)."""
    trace = np.trace(rotations, axis1=1, axis2=2)
    return np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
