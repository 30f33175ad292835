"""``unveil mask``: clicks and strokes become mattes of objects in all frames, in a folder that a run takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unveil_core.base.disk.rights import rights_of_files
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.marked import CLICKS, file_of_frame, files_named, marks_of_footage, told_of_footage
from unveil_core.drives.selecting import named_frames
from unveil_core.marking.asked.lens import in_footage, in_picture, mask_in_picture, seen_in_footage
from unveil_core.marking.asked.polarity import polarity
from unveil_core.marking.asked.prompts import Prompt, Prompts
from unveil_core.marking.asked.record import (
    MARKED,
    OfFrame,
    Recorded,
    edited,
    key_of,
    matte_name,
    new_object,
    read_record,
    write_record,
)
from unveil_core.marking.asked.said import Said, SaidObject, line_drawn, painted_pixels
from unveil_core.marking.carrying import carried
from unveil_core.marking.moving import moving_masks
from unveil_core.marking.network import Networks, Promptable
from unveil_core.marking.outline import object_outline
from unveil_core.marking.page import PAGE, Shown, sheet_name, write_page
from unveil_core.marking.seeds import Seeds
from unveil_core.marking.space.opened import Opened, opened
from unveil_core.marking.space.scene_points import scene_points
from unveil_core.pipeline.settings import RunSettings

__all__ = ["MarkedNow", "mark"]

UNNAMED = "object"
"""What an object is called that nobody named."""
MEND = "name another folder with -o"


@dataclass(frozen=True)
class MarkedNow:
    """One object as it was written.

    Attributes:
        name, id: see :class:`~unveil_core.marking.asked.record.Recorded`.
        frames: that show it. folder: of its mattes.
    """

    name: str
    id: int
    frames: int
    folder: Path


def mark(
    source: Path,
    folder: Path,
    said: Sequence[SaidObject],
    *,
    settings: RunSettings | None = None,
    moving: bool = False,
    networks: Networks | None = None,
    progress: Progress = no_progress,
    notice: Callable[[str], None] = lambda line: None,
) -> list[MarkedNow]:
    """Outline objects in all frames, and write their mattes.

    Args:
        source: a drive or a workspace.
        folder: where to; what an earlier call wrote there is added to.
        said: of objects, those of an earlier call among them; of none, what was painted over since is carried on.
        settings: which part of a drive is read, its scale and up.
        moving: whether what moves is looked for, too.
        networks: a promptable network of the user's, which then outlines in the place of colours.
        progress: called per frame; notice: what a person should know.
    Returns:
        the objects that were outlined in this call.
    Raises:
        SettingsError: nothing was said, a frame that there is not, a click outside of its picture, or files of somebody else's.
        DriveError, WorkspaceError: the source cannot be read.
    """
    with OwnFolder(folder, mend=MEND) as own:
        own.begin_anew()
        return _mark(own, source, said, settings or RunSettings(), moving, networks, progress, notice)


def _mark(
    own: OwnFolder,
    source: Path,
    said: Sequence[SaidObject],
    settings: RunSettings,
    moving: bool,
    networks: Networks | None,
    progress: Progress,
    notice: Callable[[str], None],
) -> list[MarkedNow]:
    """:func:`mark`, in a folder that is held."""
    folder, things = own.root, read_record(own.root)
    network = None if networks is None else Promptable(networks)
    painted = {t.name: edited(own, t) for t in things}
    if not any(thing.said for thing in said) and not any(painted.values()) and not moving:
        raise SettingsError(
            "Nothing to outline: neither a click nor a stroke is given, and no matte was painted over",
            mend="add --click FRAME:X,Y, or --moving",
        )
    space = opened(source, settings, progress)
    drive = space.drive
    frame_of = {key_of(f): v for v, f in enumerate(drive.frames)}
    now = [n for n in painted if painted[n]]
    pictures: dict[str, Mask] = {}
    for entry in said:
        name = entry.name or UNNAMED
        thing = next((t for t in things if t.name == name), None)
        if thing is None:
            thing = new_object(name, things, space.taken)
            things.append(thing)
            painted[name] = edited(own, thing)
        for it in entry.said:
            for one in _of_folder(it, drive, notice) if it.what == "mattes" else [it]:
                _take(one, thing, drive, folder, pictures)
        now.append(name)
    # What moves cannot be carried through a scene that stands still: what was painted of it stays, and that is all.
    chosen = [t for t in things if t.name in now and not t.moves]
    mattes = (matte_name(t, k) for t in chosen for k in frame_of if k not in painted.get(t.name, ()))
    own.check([*pictures, *mattes, PAGE, *(sheet_name(t) for t in things), CLICKS, MARKED])
    for line in told_of_footage(folder / MARKED, drive.frames):
        notice(line)
    for name, picture in pictures.items():
        write_image_atomic(own.new / name, picture.astype(np.uint8) * 255)
    cache = FrameCache()
    images = cache.frames(len(drive.frames), space.image)

    def outline(v: int, seeds: Seeds | None, prompt: Prompt | None) -> Mask:
        if network is not None:
            return network.outline(v, images[v], seeds, prompt)
        return object_outline(images[v], seeds, prompt)

    points = scene_points(drive, space.surface, measured=space.measured, cache=cache, progress=progress)
    found: list[MarkedNow] = []
    shown: list[Shown] = []
    if moving:
        for thing, masks in _moving(moving_masks(drive, points, images.__getitem__, progress), things, space):
            count = _write(own.new, thing, drive, masks, edited(own, thing))
            found.append(MarkedNow(thing.name, thing.id, count, folder / "mattes" / thing.folder))
            shown.append(Shown(thing, Prompts(thing.name, {}), masks))
        if not found:
            notice("No motion found")
    for thing in chosen:
        kept = painted.get(thing.name, [])
        prompts = _prompts(thing, kept, drive, folder, pictures, frame_of)
        masks = carried(drive, images.__getitem__, points, prompts, outline, progress)
        count = _write(own.new, thing, drive, masks, kept)
        if count <= len(prompts.frames):
            notice(
                f"{thing.name}: carried to no other frame (no other frame shows it, or it changes too much from frame to frame)"
            )
        found.append(MarkedNow(thing.name, thing.id, count, folder / "mattes" / thing.folder))
        shown.append(Shown(thing, prompts, masks))
    write_record(own.new, things, marks_of_footage(drive.frames))
    write_page(own, things, shown, drive, images.__getitem__)
    own.exchange(rights=rights_of_files(f.footage_path for f in drive.frames))
    return found


def _moving(
    motion: Sequence[dict[int, Mask]], things: list[Recorded], space: Opened
) -> Iterator[tuple[Recorded, Sequence[Mask]]]:
    """What moves, by name, and its pixels (H, W) per frame."""
    for k, of_frame in enumerate(motion, start=1):
        thing = next((t for t in things if t.name == f"moving {k}"), None)
        if thing is None:
            thing = new_object(f"moving {k}", things, space.taken)
            thing.moves = True
            things.append(thing)
        frames = space.drive.frames
        yield thing, [of_frame.get(v, np.zeros((f.camera.height, f.camera.width), bool)) for v, f in enumerate(frames)]


def _take(said: Said, thing: Recorded, drive: Drive, folder: Path, pictures: dict[str, Mask]) -> None:
    """Add what was said to an object's record; ``pictures``: what was drawn, by the name that it gets in the folder."""
    frame = _frame(said.frame, drive)
    key = key_of(frame)
    own = thing.frames.setdefault(key, OfFrame())
    assert frame.footage is not None
    camera = frame.footage.camera
    if said.what in ("inside", "outside"):
        ((x, y),) = _in_footage([said.value], said.of, frame)
        if not (0 <= x <= camera.width and 0 <= y <= camera.height):
            size = f"{camera.width}x{camera.height}"
            raise SettingsError(
                f"Not in the picture: {x:g},{y:g} of frame {said.frame}, which has {size} pixels",
                mend="count from its upper left",
            )
        if (x, y) not in (clicks := getattr(own, said.what)):  # a call that was killed is made again
            clicks.append((x, y))
        return
    kind = "matte" if said.what.startswith("matte") else "stroke"
    name = f"given/{thing.folder}/{key}_{kind}.png"
    if said.what == "line":
        width, places = said.value
        if said.of == "camera":
            width *= camera.width
        mask = line_drawn(width, _in_footage(places, said.of, frame), frame)
    else:
        mask = painted_pixels(said.value, frame)
    mask = ~mask if said.what == "matte of black" else mask
    if kind == "stroke" and not mask.any():
        problem = f"Nothing painted over frame {said.frame}"
        raise SettingsError(
            problem, path=None if said.what == "line" else said.value, mend="paint the object white, or opaque"
        )
    if kind == "stroke":
        before = pictures.get(name)
        if before is None and (folder / name).is_file():
            before = painted_pixels(folder / name, frame)
        mask = mask if before is None else mask | before
    pictures[name] = mask
    setattr(own, kind, name)


def _in_footage(places: Sequence[tuple[float, float]], of: str, frame: Frame) -> list[tuple[float, float]]:
    """Places in pixels of the footage."""
    if of == "footage":
        return list(places)
    return [(float(x), float(y)) for x, y in seen_in_footage(frame, _array(places))]


def _of_folder(said: Said, drive: Drive, notice: Callable[[str], None]) -> list[Said]:
    """The mattes of a folder, each of its frame."""
    folder: Path = said.value
    files = files_named(folder)
    found = {key_of(f): path for f in drive.frames if (path := file_of_frame(files, folder, drive, f)) is not None}
    if not found:
        mend = f"name them like the frames, as {key_of(drive.frames[0])}.png or {drive.frames[0].name}.png"
        raise SettingsError("Not mattes of this drive: no name is that of a frame", path=folder, mend=mend)
    shows = polarity(folder, list(found.values()))
    if shows == "black":
        notice(
            f"{folder.name}: black is taken for the object, for white covers most of the pictures or the name says so"
        )
    what = "matte" if shows == "white" else "matte of black"
    return [Said(key, what, path) for key, path in found.items()]


def _frame(name: str, drive: Drive) -> Frame:
    found = named_frames(drive.frames, [name], use="")
    if len(found) > 1:
        cameras = ", ".join(drive.frames[i].camera_name for i in found)
        raise SettingsError(f"Frame {name!r} is of several cameras: {cameras}", mend=f"say CAMERA/{name}")
    return drive.frames[found[0]]


def _prompts(
    thing: Recorded,
    painted: Sequence[str],
    drive: Drive,
    folder: Path,
    pictures: dict[str, Mask],
    frame_of: dict[str, int],
) -> Prompts:
    """What was said of an object, in pixels of the working pictures."""
    found = {}
    for key in dict.fromkeys([*thing.frames, *painted]):
        if key not in frame_of:
            continue  # of a part of the drive that is not read now
        frame = drive.frames[frame_of[key]]
        said = thing.frames.get(key, OfFrame())

        def picture(name: str | None, frame: Frame = frame) -> Mask | None:
            if name is None:
                return None
            mask = pictures[name] if name in pictures else painted_pixels(folder / name, frame)
            return mask_in_picture(frame, mask)

        whole = matte_name(thing, key) if key in painted else said.matte
        found[frame_of[key]] = Prompt(
            in_picture(frame, _array(said.inside)),
            in_picture(frame, _array(said.outside)),
            picture(said.stroke),
            picture(whole),
        )
    return Prompts(thing.name, found)


def _array(places: Sequence[tuple[float, float]]) -> Float64:
    return np.array(places, dtype=np.float64).reshape(-1, 2)


def _write(folder: Path, thing: Recorded, drive: Drive, masks: Sequence[Mask], kept: Sequence[str]) -> int:
    """Write an object's mattes but those that a person painted; returns how many frames show it."""
    count = 0
    for frame, mask in zip(drive.frames, masks, strict=True):
        key = key_of(frame)
        count += bool(mask.any())
        if key in kept:
            continue
        write_image_atomic(folder / matte_name(thing, key), in_footage(frame, mask).astype(np.uint8) * 255)
    return count
