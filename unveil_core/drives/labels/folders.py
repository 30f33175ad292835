"""Label pictures and instance maps from a folder of the user's, one a frame, for a drive of any layout.

Programs that label pictures name theirs after them, each in its own way: ``0007.png``, ``front/0007.png``, ``0007_labelIds.png``,
``front_0007.jpg.png``. The way is found from the pictures of one frame, and must hold for all.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.evenly import evenly
from unveil_core.drives.drive import Drive, Frame, FrameLabels
from unveil_core.drives.marked import files_named

__all__ = ["with_instance_folder", "with_label_folder"]

LAYOUT = "name the pictures CAMERA/STEM.png, or STEM.png where the drive has one camera"
STEM, CAMERA = "\0s", "\0c"
"""What stands for a frame's stem and its camera in a way of naming."""
OF_CLASSES = ("trainid", "labelid", "label", "semantic", "sem", "seg", "class")
OF_OBJECTS = ("instanceid", "instance", "panoptic", "inst", "object", "id")
"""Parts of names that pictures of classes, and instance maps, are known by, the best first."""
MOST_WAYS, MOST_PLACES = 1000, 4
"""Of naming, and of a part in one name: each way is held against all frames."""
ASKED = 5
"""Frames that are asked which ways they leave open."""
OTHERS = ("color", "colour", "overlay", "vis", "depth", "blend", "conf", "rgb")
"""Parts of names of pictures beside them that are for people or of something else."""


def with_label_folder(drive: Drive, folder: Path) -> Drive:
    """The drive with the label pictures of a folder in the place of its own.

    Args:
        drive: as read, the part of it that is asked for.
        folder: that holds one for each frame, of the photographs' size.
    Raises:
        SettingsError: there is no such folder, or it lacks that of a frame.
    """
    found = _pictures(drive, folder, "labels", OF_CLASSES)
    frames = tuple(replace(f, semantic_path=path, labels=None) for f, path in zip(drive.frames, found, strict=True))
    return replace(drive, frames=frames, semantic_classes="cityscapes")


def with_instance_folder(drive: Drive, folder: Path) -> Drive:
    """The drive with the instance maps of a folder in the place of its own, likewise."""
    found = _pictures(drive, folder, "instance maps", OF_OBJECTS)
    frames = tuple(
        replace(f, instance_path=path, labels=None if f.labels is None else partial(_without_instances, f))
        for f, path in zip(drive.frames, found, strict=True)
    )
    return replace(drive, frames=frames)


def _without_instances(frame: Frame) -> FrameLabels:
    assert frame.labels is not None
    return replace(frame.labels(), instance=None)


@dataclass(frozen=True)
class _Way:
    """A way of naming: ``pattern`` with :data:`STEM` and :data:`CAMERA` in it, and which of a frame's names its stem is."""

    pattern: str
    name: int

    def of(self, frame: Frame) -> str:
        """The key of the picture of a frame."""
        return self.pattern.replace(CAMERA, _key(frame.camera_name)).replace(STEM, _key(_names(frame)[self.name]))

    def shown(self) -> str:
        return self.pattern.replace(STEM, "STEM").replace(CAMERA, "CAMERA")


def _names(frame: Frame) -> tuple[str, str]:
    """A frame may be called otherwise than its photograph's file."""
    return frame.name, frame.image_path.stem


def _key(text: str) -> str:
    """A name without what does not tell: case, and zeros before a number."""
    return re.sub(r"\d+", lambda m: str(int(m[0])), text.casefold())


def _pictures(drive: Drive, folder: Path, what: str, known_by: Sequence[str]) -> list[Path]:
    """The picture of each frame."""
    if not folder.is_dir():
        raise SettingsError(f"no folder of {what}: {folder}", mend="give a folder with one picture a frame")
    try:
        files = files_named(folder)
    except DriveError as error:
        raise SettingsError(f"{folder}: {error.problem}", mend="name a folder of such pictures alone") from error
    exact = [next((p for p in _usual_places(f, folder, drive) if p.is_file()), None) for f in drive.frames]
    if all(exact):
        return [path for path in exact if path is not None]
    relative = {path: path.relative_to(folder).as_posix() for path in files}
    keys = Counter(_key(name) for name in relative.values())
    by_key = {_key(name): path for path, name in relative.items() if keys[_key(name)] == 1}
    ways = _fewest_ways(drive, by_key)
    if len(ways) > MOST_WAYS:
        raise SettingsError(f"{folder} names its {what} in too many ways that could be meant", mend=LAYOUT)
    complete = [w for w in ways if _tells_apart(w, drive) and all(w.of(f) in by_key for f in drive.frames)]
    if not complete:
        missing = [f for f, path in zip(drive.frames, exact, strict=True) if path is None]
        partly = [sum(w.of(f) not in by_key for f in drive.frames) for w in ways if _tells_apart(w, drive)]
        first = next(_usual_places(missing[0], folder, None)).relative_to(folder).as_posix()
        count = min([len(missing), *partly])
        problem = f"{folder} has no {what} of {count} of {len(drive.frames)} frames, the first of them {first}"
        raise SettingsError(problem, mend=LAYOUT)
    ranks = {w: _rank(w.pattern, known_by) for w in complete}
    best = min(ranks.values())
    chosen = [w for w in complete if ranks[w] == best]
    if len({tuple(by_key[w.of(f)] for f in drive.frames) for w in chosen}) > 1:
        problem = f"{folder} holds several pictures of each frame: {', '.join(sorted({w.shown() for w in chosen})[:3])}"
        raise SettingsError(problem, mend=f"name a folder with the {what} alone")
    return [by_key[chosen[0].of(f)] for f in drive.frames]


def _usual_places(frame: Frame, folder: Path, drive: Drive | None) -> Iterator[Path]:
    """Where the picture of a frame should lie, the best first; without a drive that of one with several cameras."""
    one_camera = drive is not None and len({f.camera_name for f in drive.frames}) == 1
    for stem in dict.fromkeys(_names(frame)):
        yield folder / frame.camera_name / f"{stem}.png"
        # The photographs' own folder, of which one camera may have several.
        yield folder / frame.image_path.parent.name / f"{stem}.png"
        if one_camera:
            yield folder / f"{stem}.png"


def _fewest_ways(drive: Drive, by_key: dict[str, Path]) -> list[_Way]:
    """The ways that one frame leaves open: of several frames that whose names occur least in what else names tell."""
    some = (drive.frames[i] for i in evenly(len(drive.frames), ASKED))
    found = (list(islice(_ways(frame, by_key), MOST_WAYS + 1)) for frame in some)
    return min(found, key=len)


def _ways(frame: Frame, by_key: dict[str, Path]) -> Iterator[_Way]:
    """Ways of naming in which a file is the picture of a frame."""
    camera = _key(frame.camera_name)
    for key in by_key:
        place, _, last = key.rpartition("/")
        for number, name in enumerate(_names(frame)):
            for with_stem in _replaced(last, _key(name), STEM):
                pattern = f"{place}/{with_stem}" if place else with_stem
                yield from (_Way(p, number) for p in (*_replaced(pattern, camera, CAMERA), pattern))


def _replaced(text: str, part: str, by: str) -> Iterator[str]:
    """The text with one place of a part replaced, for each that is a word of its own."""
    for match in islice(re.finditer(rf"(?<![a-z0-9]){re.escape(part)}(?![a-z0-9])", text), MOST_PLACES):
        yield text[: match.start()] + by + text[match.end() :]


def _tells_apart(way: _Way, drive: Drive) -> bool:
    """Whether a way names the pictures of different frames differently."""
    return len({way.of(f) for f in drive.frames}) == len(drive.frames)


def _rank(pattern: str, known_by: Sequence[str]) -> tuple[int, int, int]:
    """How well a way of naming is known: the lower, the better."""
    own = pattern.replace(STEM, "").replace(CAMERA, "")
    known = next((k for k, word in enumerate(known_by) if word in own), len(known_by))
    bare = re.fullmatch(r"[/_\-. ]*png", own) is not None
    return sum(word in own for word in OTHERS), 0 if bare else 1 + known, len(own)
