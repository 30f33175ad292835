"""Which part of a drive is read: cameras, frames, sweeps; and its frames by name."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from unveil_core.base.checks.numbers_in_names import counting_numbers
from unveil_core.base.drive_options import ALL_SWEEPS, KEY_SWEEPS, DriveOptions, frame_numbers
from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Drive, Frame, Sweep

__all__ = ["named_frames", "numbers_of", "select_part"]


def select_part(drive: Drive, options: DriveOptions) -> Drive:
    """The cameras, frames and sweeps that are asked for.

    Raises:
        SettingsError: a camera that the drive does not have, or a range without frames.
    """
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    wanted = options.cameras or tuple(n for n in drive.front_cameras if n in names) or ("all",)
    if wanted == ("all",):
        wanted = tuple(names)
    # One camera's photographs may lie in several folders, by which they can be asked for, too.
    folders = {f.image_path.parent.name for f in drive.frames}
    missing = [n for n in wanted if n not in names and n not in folders]
    if missing:
        raise SettingsError(f"the drive has no camera {missing[0]}", mend=f"it has {', '.join(names) or 'none'}")
    frames = drive.frames
    if options.sweeps == KEY_SWEEPS and drive.key_frames is not None:
        frames = tuple(f for f in frames if f.name in drive.key_frames)
    chosen = tuple(
        f for n in wanted for f in frames if n == (f.camera_name if n in names else f.image_path.parent.name)
    )
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


def named_frames(frames: Sequence[Frame], names: Sequence[str], *, use: str = "to be a keyframe") -> tuple[int, ...]:
    """Indices of the frames that the user names: by stem (``0007``), by camera and stem (``front/0007``), or by number (``7``).

    A number is the one by which the stems of a camera count (``frame7``); where they count by none, or none of them has it, it
    is the place in the camera's track, counted from 0. What several cameras have is a keyframe in all of them.

    Args:
        use: what they are for, in the message.
    Raises:
        SettingsError: there is no such frame.
    """
    numbers, places = numbers_of(frames), _places_of(frames)
    counts = all(re.fullmatch(r"\d{1,18}", f.name) for f in frames)
    found: list[int] = []
    for name in names:
        matches = [i for i, f in enumerate(frames) if name in (f.name, f"{f.camera_name}/{f.name}")]
        if not matches and re.fullmatch(r"\d{1,18}", name):
            matches = [i for i, number in enumerate(numbers) if number == int(name)]
        if not matches and re.fullmatch(r"\d{1,18}", name) and not counts:
            matches = [i for i, place in enumerate(places) if place == int(name)]
        if not matches:
            known = sorted(places if None in numbers else (n for n in numbers if n is not None))
            raise SettingsError(
                f"{f'Not a frame {use}'.rstrip()}: {name!r}",
                mend=f"use numbers from {known[0]} to {known[-1]}, or stems such as {frames[0].name}",
            )
        found += matches
    return tuple(dict.fromkeys(found))


def numbers_of(frames: Sequence[Frame]) -> list[int | None]:
    """The number in each frame's name by which its camera's frames count; None where they count by none."""
    found: list[int | None] = [None] * len(frames)
    for camera in dict.fromkeys(f.camera_name for f in frames):
        own = [i for i, f in enumerate(frames) if f.camera_name == camera]
        for i, number in zip(own, counting_numbers([frames[i].name for i in own]) or (), strict=False):
            found[i] = number
    return found


def _places_of(frames: Sequence[Frame]) -> list[int]:
    """The place of each frame in its camera's track."""
    found, seen = [], Counter[str]()
    for frame in frames:
        found.append(seen[frame.camera_name])
        seen[frame.camera_name] += 1
    return found
