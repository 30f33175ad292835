"""Which part of a drive is read: cameras, frames, sweeps; its frames in the order of time, and by name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from unveil_core.base.drive_options import ALL_SWEEPS, KEY_SWEEPS, DriveOptions, frame_numbers
from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Drive, Frame, Sweep

__all__ = ["in_order_of_time", "named_frames", "select_part"]


def in_order_of_time(drive: Drive) -> Drive:
    """The drive with each camera's frames by time stamp, where all of them have one; a notice where they were not."""
    ordered: list[Frame] = []
    notices = list(drive.notices)
    for name in dict.fromkeys(f.camera_name for f in drive.frames):
        track = [f for f in drive.frames if f.camera_name == name]
        stamps = [f.timestamp for f in track if f.timestamp is not None]
        if len(stamps) == len(track):
            by_time = sorted(track, key=lambda f: f.timestamp or 0.0)
            if any(a is not b for a, b in zip(track, by_time, strict=True)):
                notices.append(
                    f"camera {name}: time stamps are not in the order of the frames; frames are taken by time"
                )
            track = by_time
        ordered += track
    return replace(drive, frames=tuple(ordered), notices=tuple(notices))


def select_part(drive: Drive, options: DriveOptions) -> Drive:
    """The cameras, frames and sweeps that are asked for.

    Raises:
        SettingsError: a camera that the drive does not have, or a range without frames.
    """
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    wanted = options.cameras or tuple(n for n in drive.front_cameras if n in names) or ("all",)
    if wanted == ("all",):
        wanted = tuple(names)
    missing = [n for n in wanted if n not in names]
    if missing:
        raise SettingsError(f"the drive has no camera {missing[0]}", mend=f"it has {', '.join(names) or 'none'}")
    frames = drive.frames
    if options.sweeps == KEY_SWEEPS and drive.key_frames is not None:
        frames = tuple(f for f in frames if f.name in drive.key_frames)
    chosen = tuple(f for n in wanted for f in frames if f.camera_name == n)
    if options.frames is not None:
        chosen = _frames_of_ranges(chosen, options.frames)
        if not chosen:
            raise SettingsError(f"no frame lies in {options.frames}", mend=f"the drive has {len(frames)} frames")
    sweeps = _near_in_time(drive.sweeps, chosen) if options.frames is not None else drive.sweeps
    return replace(drive, frames=chosen, sweeps=_thinned(sweeps, options.sweeps))


def _frames_of_ranges(frames: Sequence[Frame], ranges: str) -> tuple[Frame, ...]:
    """Ranges count in the camera with most frames; the others give what was taken at the same times."""
    names = list(dict.fromkeys(f.camera_name for f in frames))
    tracks = {n: [f for f in frames if f.camera_name == n] for n in names}
    longest = max(tracks.values(), key=len, default=[])
    kept = [longest[i] for i in frame_numbers(ranges, len(longest))]
    if not kept:
        return ()
    if any(f.timestamp is None for f in frames):
        return tuple(tracks[n][i] for n in names for i in frame_numbers(ranges, len(tracks[n])))
    stamps = np.array([f.timestamp for f in longest], dtype=np.float64)
    half = 0.5 * float(np.median(np.diff(stamps))) if len(stamps) > 1 else np.inf
    times = np.array([f.timestamp for f in kept], dtype=np.float64)

    def at_those_times(frame: Frame) -> bool:
        return bool(np.abs(times - (frame.timestamp or 0.0)).min() <= half)

    return tuple(f for n in names for f in tracks[n] if (f in kept if tracks[n] is longest else at_those_times(f)))


def _near_in_time(sweeps: Sequence[Sweep], frames: Sequence[Frame]) -> tuple[Sweep, ...]:
    """Sweeps of the time of the frames, a second more at either end; all where time stamps are missing."""
    if any(s.timestamp is None for s in sweeps) or any(f.timestamp is None for f in frames):
        return tuple(sweeps)
    times = [f.timestamp or 0.0 for f in frames]
    return tuple(s for s in sweeps if min(times) - 1.0 <= (s.timestamp or 0.0) <= max(times) + 1.0)


def _thinned(sweeps: Sequence[Sweep], which: str) -> tuple[Sweep, ...]:
    if which == ALL_SWEEPS:
        return tuple(sweeps)
    if which == KEY_SWEEPS:
        annotated = tuple(s for s in sweeps if s.annotated)
        if len(annotated) < len(sweeps):
            return annotated
        return tuple(s for s in sweeps if s.boxes) or tuple(sweeps)
    return tuple(sweeps[:: int(which)])


def named_frames(frames: Sequence[Frame], names: Sequence[str]) -> tuple[int, ...]:
    """Indices of the frames that the user names: by stem (``0007``), by camera and stem (``front/0007``), or by number (``7``).

    A number is the one in the stem where all stems are numbers, else the place in the camera's track, counted from 0. What
    several cameras have is a keyframe in all of them.

    Raises:
        SettingsError: there is no such frame.
    """
    numbers = [int(f.name) if re.fullmatch(r"\d{1,18}", f.name) else None for f in frames]
    if None in numbers:
        places: dict[str, int] = {}
        for i, f in enumerate(frames):
            numbers[i] = places[f.camera_name] = places.get(f.camera_name, -1) + 1
    found: list[int] = []
    for name in names:
        matches = [i for i, f in enumerate(frames) if name in (f.name, f"{f.camera_name}/{f.name}")]
        if not matches and re.fullmatch(r"\d{1,18}", name):
            matches = [i for i, number in enumerate(numbers) if number == int(name)]
        if not matches:
            known = sorted(number for number in numbers if number is not None)
            raise SettingsError(
                f"there is no frame {name!r} to be a keyframe",
                mend=f"use numbers from {known[0]} to {known[-1]}, or stems such as {frames[0].name}",
            )
        found += matches
    return tuple(dict.fromkeys(found))
