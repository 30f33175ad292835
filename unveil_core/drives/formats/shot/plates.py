"""The plates of a shot: picture sequences that lie beside a camera path, and which picture belongs to which frame of it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.on_disk.pictures import pictures_in
from unveil_core.drives.formats.shot.described import Described

__all__ = ["Matched", "by_name", "by_number", "named_pictures", "plates_beside", "sequence_of"]

DIGITS = re.compile(r"([0-9]+)")
PATTERN = re.compile(r"(.*?)(#+|%0?[0-9]*d)(.*)", re.DOTALL)
FOLDERS = ("plates", "images", "undistorted", "frames", "input", "photos")
"""That are looked into beside a path, before any other."""
OTHERS = frozenset(("mask", "masks", "mattes", "semantics", "instances", "labels", "depth", "truth"))
"""That hold pictures of another kind."""
SHOWN = 4


@dataclass(frozen=True)
class Matched:
    """Attributes:
    pictures: by position in the path; frames without a picture are missing.
    notices: what a user should know, one line each.
    """

    pictures: dict[int, Path]
    notices: tuple[str, ...]


def sequence_of(path: Path, said: Described) -> dict[int, Path]:
    """The plates by their numbers.

    Args:
        path: of the camera path.
    Raises:
        DriveError: there are none, or several sequences of which nothing tells which is meant.
    """
    pattern = said.plates and PATTERN.fullmatch(Path(said.plates).name)
    found: dict[str, dict[int, Path]] = {}
    for folder in _folders(path, said):
        found = {
            kind: {number: folder / name for number, name in numbers.items()}
            for kind, numbers in _sequences(pictures_in(folder)).items()
            if not pattern or kind == f"{pattern[1]}#{pattern[3]}"
        }
        if found:
            break
    if not found:
        where = "" if said.plates is None else f" as {said.plates[:60]}"
        raise DriveError(
            f"has no plates beside it{where}",
            path=path,
            mend='put the picture sequence beside it or into plates/, or set "plates" in shot.json to its folder',
        )
    if len(found) > 1:
        kinds = ", ".join(list(found)[:SHOWN])
        raise DriveError(
            f"has {len(found)} picture sequences beside it: {kinds}",
            path=path,
            mend='name one by "plates" in shot.json',
        )
    return next(iter(found.values()))


def _sequences(names: Sequence[str]) -> dict[str, dict[int, str]]:
    """Names of files by what of them stays, with # for what counts, and by number: that one of their numbers that changes, of
    several the last."""
    alike: dict[tuple[str, ...], list[list[str]]] = {}
    for name in names:
        parts = DIGITS.split(name.rpartition(".")[0])
        if len(parts) > 1:
            alike.setdefault((*parts[::2], name.rpartition(".")[2]), []).append(parts)
    found: dict[str, dict[int, str]] = {}
    for (*_, suffix), group in alike.items():
        changing = [k for k in range(1, len(group[0]), 2) if len({int(parts[k]) for parts in group}) > 1]
        at = changing[-1] if changing else len(group[0]) - 2
        for parts in group:
            kind = "".join([*parts[:at], "#", *parts[at + 1 :], ".", suffix])
            found.setdefault(kind, {}).setdefault(int(parts[at]), "".join([*parts, ".", suffix]))
    return found


def named_pictures(path: Path, said: Described) -> dict[str, Path]:
    """The pictures beside a path by their names in small letters, with and without suffix.

    Raises:
        DriveError: there are none.
    """
    found: dict[str, Path] = {}
    for folder in _folders(path, said):
        for name in pictures_in(folder):
            for key in (name.lower(), name.lower().rpartition(".")[0]):
                found.setdefault(key, folder / name)
    if not found:
        raise DriveError(
            "has no pictures beside it",
            path=path,
            mend='put them beside it or into images/, or set "plates" in shot.json',
        )
    return found


def plates_beside(path: Path) -> bool:
    """Whether any pictures lie where those of a camera path are looked for."""
    return any(pictures_in(folder) for folder in _folders(path, Described()))


def _folders(path: Path, said: Described) -> list[Path]:
    root = path.parent if said.source is None else said.source.parent
    if said.plates is not None:
        named = named_path(root, said.plates, said.source or path, "plates")
        folder = named.parent if PATTERN.fullmatch(named.name) else named
        if not folder.is_dir():
            raise DriveError(f"Not a folder: {folder}, named as plates", path=said.source, mend="correct plates")
        return [folder]
    inner = {p.name.lower(): p for p in root.iterdir() if p.is_dir()}
    usual = [inner[name] for name in FOLDERS if name in inner]
    return [root, *usual, *(p for name, p in sorted(inner.items()) if name not in OTHERS.union(FOLDERS))]


def by_number(numbers: Sequence[int], plates: dict[int, Path], said: Described, path: Path) -> Matched:
    """Match frames of a path and plates by their numbers.

    Raises:
        DriveError: none has a plate.
    """
    offset, notices = said.frame_offset or 0, []
    ranges = f"the path has frames {min(numbers)} to {max(numbers)}, the plates are {min(plates)} to {max(plates)}"
    if said.frame_offset is None and not any(n in plates for n in numbers):
        if len(numbers) != len(plates):
            raise DriveError(f"no frame has a plate: {ranges}", path=path, mend='set "frame_offset" in shot.json')
        offset = min(plates) - min(numbers)
        notices.append(f"{ranges}: as many, so they are taken in order; frame_offset in shot.json decides")
    pictures = {i: plates[n + offset] for i, n in enumerate(numbers) if n + offset in plates}
    if not pictures:
        raise DriveError(f"no frame has a plate: {ranges}", path=path, mend=f"frame_offset {offset} is not right")
    lost = len(numbers) - len(pictures)
    if lost:
        notices.append(f"{lost} of {len(numbers)} frames of the path have no plate and are left out: {ranges}")
    over = len(plates) - len(pictures)
    if over:
        notices.append(f"{over} of {len(plates)} plates have no frame of the path and are not read: {ranges}")
    return Matched(pictures, tuple(notices))


def by_name(names: Sequence[str], there: dict[str, Path], path: Path) -> Matched:
    """Match pictures that a path names and those that are there.

    Raises:
        DriveError: none is there.
    """
    pictures: dict[int, Path] = {}
    for i, name in enumerate(names):
        key = name.replace("\\", "/").rpartition("/")[2].lower()
        place = there.get(key) or there.get(key.rpartition(".")[0])
        if place is not None:
            pictures[i] = place
    missing = [name for i, name in enumerate(names) if i not in pictures]
    if not pictures:
        raise DriveError(
            f"none of its {len(names)} pictures is there, the first {missing[0][:40]}",
            path=path,
            mend='put them beside it or into images/, or set "plates" in shot.json',
        )
    named = ", ".join(n[:40] for n in missing[:SHOWN])
    told = (f"{len(missing)} of {len(names)} pictures are not there and are left out: {named}",) if missing else ()
    return Matched(pictures, told)
