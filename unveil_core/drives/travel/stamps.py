"""Time stamps in seconds, whatever unit a file has them in: one place for all readers.

Files say nothing of the unit. It follows from the steps: cameras take a picture every few hundredths of a second to every few
seconds, so steps of 33 are milliseconds, and of 33,333,333 nanoseconds. Seconds, as documented, are believed wherever they can be.
Where the steps fit two units, the date since 1970 decides, then how fast the vehicle would be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from unveil_core.drives.drive import Drive, Frame, tracks

__all__ = ["Unit", "in_seconds", "stamp_of", "unit_of"]


@dataclass(frozen=True)
class Unit:
    """A unit of time: its name, and how many of it are a second."""

    name: str
    per_second: float


SECONDS = Unit("seconds", 1.0)
UNITS = (SECONDS, Unit("milliseconds", 1e3), Unit("microseconds", 1e6), Unit("nanoseconds", 1e9))
LONGEST_STEP_S, SHORTEST_STEP_S = 10.0, 1 / 1000
"""Between two pictures of a camera, or two sweeps of a LiDAR, that are one drive: what is beyond is another unit."""
USUAL_STEPS_S = (1 / 130, 2.1)
"""Steps of cameras of drives: a unit with such is believed before one without."""
MOST_SECONDS = 1e11
"""Seconds since 1970 have 10 digits; whole numbers of 12 and more are of another unit."""
DATES_S = (6.3e8, 4.1e9)
"""Seconds since 1970 of the years 1990 to 2100."""
SPEEDS = (0.1, 70.0)
"""Of people and vehicles that film, metres a second."""
FASTEST_SHARE = 100.0
"""Stamps from 0 to 1 that make the vehicle faster, metres a second, are shares of the drive, as dynamic NeRFs have them."""


def stamp_of(value: object) -> float | None:
    """A time stamp as files have it: a number or a text of one, a date by ISO 8601, ``HH:MM:SS.f``, or ROS' seconds and
    nanoseconds in an object; None where it is none of these."""
    if isinstance(value, dict):
        parts = [next((value[k] for k in keys if k in value), None) for keys in (SECOND_KEYS, NANOSECOND_KEYS)]
        numbers = [stamp_of(p) if p is not None else 0.0 for p in parts]
        if parts[0] is None or None in numbers:
            return None
        return float(numbers[0] or 0.0) + float(numbers[1] or 0.0) / 1e9
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        found = float(value)
    except ValueError:
        found = _date(str(value).strip())
    except OverflowError:
        return None
    return found if math.isfinite(found) else None


SECOND_KEYS, NANOSECOND_KEYS = ("secs", "sec"), ("nsecs", "nsec", "nanosec", "nanosecs")


def _date(text: str) -> float:
    """Seconds of a date, since 1970, or of a time of day; NaN of another text."""
    try:
        if text[2:3] == ":":
            hours, minutes, seconds = text.split(":")
            return 3600 * int(hours) + 60 * int(minutes) + float(seconds)
        if text[4:5] == text[7:8] == ":":  # EXIF
            text = text.replace(":", "-", 2)
        whole, point, rest = text.partition(".")
        digits = rest[: len(rest) - len(rest.lstrip("0123456789"))]
        # Nanoseconds are more digits than a datetime keeps.
        date = datetime.fromisoformat(whole + rest[len(digits) :])
        date = date if date.tzinfo is not None else date.replace(tzinfo=UTC)
        return date.timestamp() + (float(f"0.{digits}") if point and digits else 0.0)
    except (ValueError, OverflowError):
        return math.nan


def in_seconds(drive: Drive) -> Drive:
    """The drive with the time stamps of its frames and sweeps in seconds; a notice where they were of another unit."""
    notices = list(drive.notices)
    frames, sweeps = drive.frames, drive.sweeps
    stamps = [[frames[i].timestamp for i in track] for track in tracks(drive)]
    found = unit_of(stamps, _metres_a_step(drive))
    if found is None:
        step = _plain(_step(stamps))
        notices.append(f"time stamps step by {step}: no camera does so in any unit; they are taken as seconds")
    elif found is not SECONDS:
        frames = tuple(replace(f, timestamp=_in(found, f.timestamp)) for f in frames)
        notices.append(_told(found, stamps, "time stamps"))
    elif _is_share(stamps, _metres_a_step(drive)):
        frames = tuple(replace(f, timestamp=None) for f in _by_stamps(frames))
        notices.append("time stamps run from 0 to 1, a share of the drive and not seconds: they only order the frames")
    of_sweeps = [[s.timestamp for s in sweeps]]
    found = unit_of(of_sweeps)
    if found is not None and found is not SECONDS:
        sweeps = tuple(replace(s, timestamp=_in(found, s.timestamp)) for s in sweeps)
        notices.append(_told(found, of_sweeps, "time stamps of LiDAR sweeps"))
    return replace(drive, frames=frames, sweeps=sweeps, notices=tuple(notices))


def _in(kind: Unit, stamp: float | None) -> float | None:
    return None if stamp is None else stamp / kind.per_second


def _told(kind: Unit, stamps: Sequence[Sequence[float | None]], what: str) -> str:
    step = _step(stamps)
    why = f"their steps would be {_plain(step)} s" if step > 0 else "they have too many digits for seconds"
    return f"{what} count as {kind.name} and are converted: {why}"


def _plain(number: float) -> str:
    """300,000,000 and 12.5."""
    return f"{number:,.0f}" if number >= 100 else f"{number:g}"


def unit_of(stamps: Sequence[Sequence[float | None]], metres_a_step: float | None = None) -> Unit | None:
    """The unit of time stamps.

    Args:
        stamps: of each camera's frames; None = a frame has none.
        metres_a_step: how far the vehicle goes between frames, where it moves and the scale is known.
    Returns:
        seconds where nothing tells otherwise, None where the steps are those of cameras in no unit.
    """
    known = [abs(t) for some in stamps for t in some if t is not None]
    largest = max(known, default=0.0)
    step = _step(stamps)
    if step == 0:
        fitting = [u for u in UNITS if largest / u.per_second < MOST_SECONDS]
        return fitting[0] if fitting else SECONDS
    possible = [u for u in UNITS if SHORTEST_STEP_S <= step / u.per_second <= LONGEST_STEP_S]
    if SECONDS in possible and largest < MOST_SECONDS:
        faster = [u for u in possible if _is_usual(step, u) and _is_driven(step, u, metres_a_step)]
        slow = metres_a_step is not None and metres_a_step / step < SPEEDS[0]
        return faster[0] if slow and faster else SECONDS
    sparse = _is_driven(step, SECONDS, metres_a_step) and largest < MOST_SECONDS and step <= 12 * LONGEST_STEP_S
    if sparse and not any(_is_driven(step, u, metres_a_step) for u in possible):
        return SECONDS  # a photograph every half a minute while somebody walks
    if not possible:
        return SECONDS if step < SHORTEST_STEP_S else None

    def rank(kind: Unit) -> tuple[bool, bool, bool]:
        dated = DATES_S[0] <= largest / kind.per_second <= DATES_S[1]
        return not _is_usual(step, kind), not dated, not _is_driven(step, kind, metres_a_step)

    return min(possible, key=rank)


def _step(stamps: Sequence[Sequence[float | None]]) -> float:
    """The median step between stamps of one camera in their order, 0 where there is none."""
    steps = [np.diff(np.unique([t for t in some if t is not None])) for some in stamps]
    every = np.concatenate(steps) if steps else np.zeros(0)
    every = every[np.isfinite(every)]
    return float(np.median(every)) if len(every) else 0.0


def _is_usual(step: float, kind: Unit) -> bool:
    return USUAL_STEPS_S[0] <= step / kind.per_second <= USUAL_STEPS_S[1]


def _is_driven(step: float, kind: Unit, metres_a_step: float | None) -> bool:
    """Whether the vehicle's speed is one, as far as that is known."""
    return metres_a_step is not None and SPEEDS[0] <= metres_a_step * kind.per_second / step <= SPEEDS[1]


def _metres_a_step(drive: Drive) -> float | None:
    """The median way between frames of one camera in the order of their stamps; None where the scale is not known, or nothing
    moves."""
    if drive.units_per_metre is None:
        return None
    steps = []
    for track in tracks(drive):
        own = [drive.frames[i] for i in track if drive.frames[i].timestamp is not None]
        centres = np.stack([f.camera.centre for f in _by_stamps(own)]) if len(own) > 1 else np.zeros((1, 3))
        with np.errstate(all="ignore"):
            steps.append(np.linalg.norm(np.diff(centres, axis=0), axis=1))
    every = np.concatenate(steps) if steps else np.zeros(0)
    every = every[np.isfinite(every)] / drive.units_per_metre
    middle = float(np.median(every)) if len(every) else 0.0
    return middle if middle > 0.01 else None


def _by_stamps(frames: Sequence[Frame]) -> list[Frame]:
    return sorted(frames, key=lambda f: f.timestamp or 0.0)


def _is_share(stamps: Sequence[Sequence[float | None]], metres_a_step: float | None) -> bool:
    known = [t for some in stamps for t in some if t is not None]
    step = _step(stamps)
    ends = len(known) > 2 and min(known) == 0 and max(known) == 1
    return ends and metres_a_step is not None and step > 0 and metres_a_step / step > FASTEST_SHARE
