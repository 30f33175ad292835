"""Which camera took which picture, where nothing says it: found from how the pictures move, told as the guess that it is.

Pictures are grouped by their folders, by words and numbers in their names, by lens, by turns. The first grouping whose groups are
cameras of a rig is taken (see ``side_by_side``); groups of one camera, as the folders of a card or the focal lengths of autofocus,
are put together.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from unveil_core.base.checks.names import file_name
from unveil_core.base.checks.numbers_in_names import columns_of, counting_numbers, natural_key
from unveil_core.base.types import Float64
from unveil_core.drives.travel.side_by_side import APART, RIG, SAME, Group, is_smooth, relation, roughness

__all__ = ["ALONE", "Guess", "Shot", "guessed_cameras"]

ALONE = "camera"
"""Name of the camera of a drive that has one and does not name it."""
MOST_GROUPS = 32
"""Groups that are compared: a rig has a dozen cameras, a card that many folders."""
MOST_CAMERAS, LEAST_FRAMES = 16, 3
"""Of a rig that only names, lenses or turns tell, and pictures of each."""
MOST_TURNS = 8
"""Cameras that may take turns in one sequence of names."""
FARTHEST = 1e100
"""Numbers of poses that can be squared."""
NAMED = 3
"""Folders or words that a notice names."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What is known of one picture.

    Attributes:
        path: within the drive, with ``/``, without suffix.
        lens: width, height, focal length and whatever else makes it another lens than others; pixels.
        pose: (4, 4) camera-to-world, axes as OpenCV has them.
        time: its time stamp in any unit, or None.
    """

    path: str
    lens: tuple[float, ...]
    pose: Float64
    time: float | None = None

    @property
    def folder(self) -> str:
        """That it lies in, within the drive; "" for the drive's own."""
        return "/".join(p for p in self.path.split("/")[:-1] if p not in ("", ".", ".."))

    @property
    def stem(self) -> str:
        """The name of its file."""
        return self.path.rpartition("/")[2]

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return self.lens[2]


@dataclass(frozen=True)
class Guess:
    """Attributes:
    names: of the camera of each picture; notice: how it was guessed, None where there was nothing to guess.
    """

    names: list[str]
    notice: str | None = None


class _Pictures:
    """All pictures of a drive.

    Attributes:
        shots; folders and stems of their files; poses: (N, 4, 4).
        timed: whether all have time stamps.
        order: indices by time stamps where they are timed, then by names; place: of each in it.
    """

    def __init__(self, shots: Sequence[Shot]) -> None:
        self.shots = shots
        self.folders, self.stems = [s.folder for s in shots], [s.stem for s in shots]
        self.poses = np.stack([s.pose for s in shots])
        self.timed = all(s.time is not None for s in shots)
        keys = [natural_key(s.path) for s in shots]
        times = [s.time or 0.0 if self.timed else 0.0 for s in shots]
        self.order = sorted(range(len(shots)), key=lambda i: (times[i], keys[i]))
        self.place = {i: k for k, i in enumerate(self.order)}


@dataclass(frozen=True)
class _Grouping:
    """Attributes:
    kind: what the pictures are grouped by. labels: of each picture. moments: its name without what tells the groups apart.
    strict: nothing but motion speaks for several cameras: it has to speak clearly.
    """

    kind: str
    labels: list[str]
    moments: list[str]
    strict: bool = True


def guessed_cameras(shots: Sequence[Shot], decides: str, *, whole_folders: bool = False) -> Guess:
    """The cameras of some pictures, in their order.

    Args:
        decides: what a user may say instead, for the notice.
        whole_folders: whether folders name cameras with all that they lie in, and a single one does, too.
    """
    pictures = _Pictures(shots)
    folder = pictures.folders[0]
    alone = file_name(folder, ALONE) if whole_folders and {folder} == set(pictures.folders) else ALONE
    if len(shots) < 2 or not (np.abs(pictures.poses) < FARTHEST).all():
        return Guess([alone] * len(shots))
    one_of: _Grouping | None = None
    for grouping in _groupings(pictures):
        sets, related = _sets(grouping, pictures)
        if len(sets) > 1 and (related or not grouping.strict):
            names = _names(grouping, sets, whole_folders)
            names = _with_turns(names, shots) if grouping.kind == "lenses" else names
            return Guess(names, _told_rig(grouping, names, related, decides))
        if len(set(grouping.labels)) > 1 and grouping.kind in ("folders", "lenses"):
            one_of = one_of or grouping
    if one_of is None and 1 < len({s.focal for s in shots}) <= MOST_CAMERAS:
        one_of = _Grouping("lenses", [repr(s.focal) for s in shots], [])
    return Guess([alone] * len(shots), None if one_of is None else _told_one(one_of, shots, decides))


# Groupings


def _groupings(pictures: _Pictures) -> Iterator[_Grouping]:
    shots, folders, stems = pictures.shots, pictures.folders, pictures.stems
    count = len(set(folders))
    # Folders with the same few names in each are moments, not cameras.
    of_cameras = count <= len(set(stems)) or len(set(stems)) == 1
    if of_cameras and 1 < count <= MOST_GROUPS and count < len(shots):
        yield _Grouping("folders", folders, stems, strict=False)
    yield from _by_names([f"{f}/{s}" for f, s in zip(folders, stems, strict=True)] if count > 1 else stems)
    lenses = [repr(s.lens) for s in shots]
    if count == 1 and _are_cameras(lenses):
        yield _Grouping("lenses", lenses, stems, strict=False)
    if count == 1:
        yield from _by_turns(pictures)


def _are_cameras(labels: Sequence[str]) -> bool:
    found = Counter(labels)
    return 1 < len(found) <= MOST_CAMERAS and min(found.values()) >= LEAST_FRAMES


def _by_names(names: Sequence[str]) -> Iterator[_Grouping]:
    """By words in the names, as ``left_0001`` and ``right_0001``, then by each of their numbers that counts only a few."""
    parts = [_split(n) for n in names]
    words = ["#".join(p[::2]) for p in parts]
    if _are_cameras(words):
        yield _Grouping("names", words, ["#".join(p[1::2]) for p in parts])
    columns = columns_of(names)
    if columns is None:
        return
    # Cameras are fewer than moments.
    numbers = sorted(range(1, len(columns[0]), 2), key=lambda k: len({c[k] for c in columns}))
    for k in numbers:
        labels = [c[k] for c in columns]
        if _are_cameras(labels):
            yield _Grouping("names", labels, ["".join(p for i, p in enumerate(c) if i != k) for c in columns])


def _split(name: str) -> tuple[str, ...]:
    columns = columns_of([name])
    return (name,) if columns is None else columns[0]


def _by_turns(pictures: _Pictures) -> Iterator[_Grouping]:
    """One sequence in which cameras take turns, or stand one after the other."""
    shots, order = pictures.shots, pictures.order
    centres = pictures.poses[order, :3, 3]
    rotations = pictures.poses[order, :3, :3]
    if not is_smooth(centres, rotations):
        possible = [k for k in range(2, MOST_TURNS + 1) if len(shots) >= k * LEAST_FRAMES]
        # Of six cameras every second is no camera, though such groups may keep their distance, too: the smoothest first.
        for turns in sorted(possible, key=lambda k: roughness(centres, rotations, k)):
            labels = [""] * len(shots)
            for place, i in enumerate(order):
                labels[i] = str(place % turns + 1)
            yield _Grouping("turns", labels, [s.path for s in shots])
    with np.errstate(all="ignore"):
        steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
        extent = np.linalg.norm(np.ptp(centres, axis=0))
        jumps = np.flatnonzero((steps > 5 * np.median(steps)) & (steps > 0.5 * extent))
    if 0 < len(jumps) < MOST_TURNS:
        labels = [""] * len(shots)
        for place, i in enumerate(order):
            labels[i] = str(int((jumps < place).sum()) + 1)
        if min(Counter(labels).values()) >= LEAST_FRAMES:
            yield _Grouping("turns", labels, [s.path for s in shots])


def _with_turns(names: list[str], shots: Sequence[Shot]) -> list[str]:
    """Cameras that lenses tell apart, and of those that have one lens the ones that take turns; numbered anew."""
    labels = list(names)
    for name in dict.fromkeys(names):
        own = [i for i, n in enumerate(names) if n == name]
        pictures = _Pictures([shots[i] for i in own])
        for grouping in _by_turns(pictures):
            sets, related = _sets(grouping, pictures)
            if len(sets) > 1 and related:
                for i, label in zip(own, grouping.labels, strict=True):
                    labels[i] = f"{name} {label}"
                break
    numbers = {label: f"{ALONE}_{k}" for k, label in enumerate(dict.fromkeys(labels), start=1)}
    return [numbers[label] for label in labels]


# Groups that are one camera


def _sets(grouping: _Grouping, pictures: _Pictures) -> tuple[list[list[str]], bool]:
    """The labels of each camera, and whether any two cameras are a rig's."""
    members: dict[str, list[int]] = {}
    for i, label in enumerate(grouping.labels):
        members.setdefault(label, []).append(i)
    timed = pictures.timed and all(_tells(own, pictures.shots) for own in members.values())
    groups = {label: _group(own, grouping, pictures, timed) for label, own in members.items()}
    labels = list(groups)
    related: dict[tuple[str, str], str] = {}
    for i, a in enumerate(labels):
        for b in labels[i + 1 :]:
            related[a, b] = related[b, a] = relation(
                groups[a], groups[b], timed=timed, clear=grouping.kind == "turns", zooms=grouping.kind == "lenses"
            )
        if grouping.kind == "turns" and any(related[a, b] != RIG for b in labels if b != a):
            return [labels], False
    sets = [[label] for label in labels]
    # Of a rig with several folders a camera, those that are alike belong together.
    pairs = [(a, b) for i, a in enumerate(labels) for b in labels[i + 1 :] if related[a, b] == SAME]
    for a, b in sorted(pairs, key=lambda p: -len(os.path.commonprefix(p))):
        first, second = (next(s for s in sets if label in s) for label in (a, b))
        if first is not second and not any(related[p, q] in (RIG, APART) for p in first for q in second):
            first += second
            sets.remove(second)
    return sets, any(r == RIG for r in related.values())


def _tells(own: Sequence[int], shots: Sequence[Shot]) -> bool:
    """Whether time stamps of a group tell its pictures apart."""
    return len({shots[i].time for i in own}) * 2 > len(own)


def _group(own: list[int], grouping: _Grouping, pictures: _Pictures, timed: bool) -> Group:
    own = sorted(own, key=pictures.place.__getitem__)
    shots, poses, clock = pictures.shots, pictures.poses[own], None
    if timed:
        clock = np.array([shots[i].time for i in own], dtype=np.float64)
    else:
        numbers = counting_numbers([grouping.moments[i] for i in own])
        if numbers is not None and numbers == sorted(numbers):
            clock = np.array(numbers, dtype=np.float64)
    return Group(
        poses[:, :3, 3],
        poses[:, :3, :3],
        clock,
        (int(shots[own[0]].lens[0]), int(shots[own[0]].lens[1])),
        float(np.median([shots[i].focal for i in own])),
        frozenset(grouping.moments[i] for i in own),
    )


# Names and notices


def _names(grouping: _Grouping, sets: Sequence[Sequence[str]], whole_folders: bool) -> list[str]:
    """Of the camera of each picture: its folder or the word in its names; by number where nothing names it."""
    if grouping.kind == "folders":
        shared = "" if whole_folders else _shared_folder(grouping.labels)
        of_set = [file_name(_common(own).removeprefix(shared).strip("/"), ALONE) for own in sets]
        if len(set(of_set)) < len(of_set):
            of_set = [file_name(own[0].removeprefix(shared).strip("/"), ALONE) for own in sets]
    elif grouping.kind == "names":
        words = [[w for w in re.split(r"[\W_]+", own[0]) if w] for own in sets]
        common = set.intersection(*map(set, words))
        of_set = [file_name("_".join(w for w in own if w not in common), "") for own in words]
        of_set = of_set if all(of_set) else [file_name("_".join(own), "") for own in words]
        if "" in of_set or len(set(of_set)) < len(of_set):
            of_set = [f"{ALONE}_{k}" for k in range(1, len(sets) + 1)]
        of_set = [f"{ALONE}_{name}" if name.isdigit() else name for name in of_set]
    else:
        of_set = [f"{ALONE}_{k}" for k in range(1, len(sets) + 1)]
    by_label = {label: name for own, name in zip(sets, of_set, strict=True) for label in own}
    return [by_label[label] for label in grouping.labels]


def _shared_folder(folders: Sequence[str]) -> str:
    # Absolute ones beside relative ones share nothing.
    return os.path.commonpath(folders) if all(folders) and len({f[:1] == "/" for f in folders}) == 1 else ""


def _common(folders: Sequence[str]) -> str:
    return folders[0] if len(folders) == 1 else _shared_folder(list(folders)) or folders[0]


def _told_rig(grouping: _Grouping, names: Sequence[str], related: bool, decides: str) -> str:
    cameras = list(dict.fromkeys(names))
    by = {"folders": "their folders", "names": "the names of their pictures", "lenses": "their lenses"}
    told = by.get(grouping.kind, "turns that they take")
    why = "they keep their distance and angle" if related else "they do not move as one camera"
    return f"{len(cameras)} cameras are told apart by {told}, {_some(cameras)}: {why}; {decides} decides"


def _told_one(grouping: _Grouping, shots: Sequence[Shot], decides: str) -> str:
    labels = list(dict.fromkeys(grouping.labels))
    if grouping.kind == "folders":
        what = f"pictures of {len(labels)} folders, {_some([label or '.' for label in labels])},"
    else:
        focals = [s.focal for s in shots]
        what = f"pictures of {len(labels)} focal lengths, {min(focals):.1f} to {max(focals):.1f} pixels,"
    return f"{what} count as those of one camera: they follow each other on one path; {decides} decides"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "")
