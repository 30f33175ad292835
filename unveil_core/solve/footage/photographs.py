"""Folders of photographs: taken as they are; those that a viewer turns are written upright."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime, timedelta
from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.checks.names import distinct_file_names
from unveil_core.base.disk.open_safely import read_bytes
from unveil_core.base.drive_options import frame_numbers
from unveil_core.base.errors import DriveError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.output.copies import copied
from unveil_core.base.pictures.decoding import read_image_as_it_is, read_metadata, size_of_image
from unveil_core.base.pictures.exif import exif_facts
from unveil_core.base.pictures.metadata import metadata_of
from unveil_core.base.pictures.orientation import orientation_of
from unveil_core.base.progress import Progress, no_progress
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.footage.kinds import pictures_in
from unveil_core.solve.settings import focal_of_film

__all__ = ["take_photographs"]

TURNS = {3: cv2.ROTATE_180, 6: cv2.ROTATE_90_CLOCKWISE, 8: cv2.ROTATE_90_COUNTERCLOCKWISE}
"""Of EXIF's orientations those that cameras write; mirrored ones are of scanners."""


def take_photographs(
    source: Path,
    images: Path,
    camera: str,
    frames: str | None,
    every: int,
    folder: str,
    progress: Progress = no_progress,
) -> Reel:
    """Copy the photographs of a folder into ``images/FOLDER``, in the order of their names; files that are there stay.

    Args:
        frames: "A:B:STEP" or None; every: of these each so many-th; folder: within ``images``, "" for none.
    Raises:
        DriveError: there are none, one cannot be read, or they are of several sizes.
    """
    every_file = pictures_in(source)
    chosen = frame_numbers(frames, len(every_file)) if frames is not None else list(range(len(every_file)))
    chosen = chosen[::every]
    if not chosen:
        raise DriveError("has no photographs in that part", path=source, mend="give --frames within the folder")
    (images / folder).mkdir(parents=True, exist_ok=True)
    twice = {stem for stem, n in Counter(every_file[i].stem for i in chosen).items() if n > 1}
    stems = {p: p.name.replace(".", "_") if p.stem in twice else p.stem for p in (every_file[i] for i in chosen)}
    called = distinct_file_names(stems.values())
    found: list[FootageFrame] = []
    sizes: dict[tuple[int, int], int] = {}
    equivalents: list[float] = []
    bits = 8
    for done, number in enumerate(chosen):
        path = every_file[number]
        content = read_bytes(path)
        turn = TURNS.get(orientation_of(content))
        name = called[stems[path]]
        file = f"{name}{path.suffix}" if turn is None and path.suffix.lower() != ".webp" else f"{name}.png"
        file = f"{folder}/{file}" if folder else file
        width, height = size_of_image(content, path)
        size = (height, width) if turn in (cv2.ROTATE_90_CLOCKWISE, cv2.ROTATE_90_COUNTERCLOCKWISE) else (width, height)
        sizes.setdefault(size, number)
        if not (images / file).is_file():
            _place(path, images / file, turn)
        if done == 0:
            bits = 16 if read_image_as_it_is(path).dtype == np.uint16 else 8
        exif = exif_facts(metadata_of(content).exif)
        if exif.focal_35mm is not None:
            equivalents.append(exif.focal_35mm)
        time = _seconds(exif.taken, exif.utc_offset_s)
        found.append(FootageFrame(camera, name, number, file, time, exif.latitude, exif.longitude))
        progress(done + 1, len(chosen), "taking photographs")
    if len(sizes) > 1:
        (a, _), (b, at) = list(sizes.items())[:2]
        raise DriveError(
            f"Two sizes of pictures: {a[0]}x{a[1]} and, at {every_file[at].name}, {b[0]}x{b[1]}",
            path=source,
            mend="put the pictures of each camera into a folder of its own",
        )
    size = next(iter(sizes))
    focal = float(np.median(equivalents)) if equivalents else None
    return Reel(
        camera,
        str(source),
        size,
        bits,
        _timed(found),
        None if focal is None else focal_of_film(focal, size),
        "" if focal is None else f"EXIF, {focal:g} mm as of 35 mm film",
    )


def _place(path: Path, target: Path, turn: int | None) -> None:
    if turn is None and target.suffix == path.suffix:
        copied(path, target)
        return
    picture = read_image_as_it_is(path)
    upright = picture if turn is None else cv2.rotate(picture, turn)
    write_image_atomic(target, upright, like=path, metadata=read_metadata(path).of_color)


def _seconds(taken: str | None, offset_s: float | None) -> float | None:
    """Seconds since 1970 of EXIF's time; without an offset as if it were UTC."""
    if taken is None:
        return None
    try:
        moment = datetime.strptime(taken, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    return (moment - timedelta(seconds=offset_s or 0.0)).timestamp()


def _timed(frames: list[FootageFrame]) -> tuple[FootageFrame, ...]:
    """Times are kept where they rise from picture to picture: EXIF counts whole seconds, and bursts share one."""
    times = [f.time_s for f in frames]
    known = [t for t in times if t is not None]
    if len(known) == len(times) and all(b > a for a, b in zip(known, known[1:], strict=False)):
        return tuple(frames)
    return tuple(FootageFrame(f.camera, f.name, f.number, f.file, None, f.latitude, f.longitude) for f in frames)
