"""Frames of footage as they lie on disk, decoded, in the folder of a solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json, write_json_atomic

__all__ = ["FootageFrame", "Reel", "own_names", "read_reel", "write_reel"]


@dataclass(frozen=True)
class FootageFrame:
    """One frame.

    Attributes:
        camera: that took it.
        name: its stem; number: in its clip or folder, from 0.
        file: relative to the drive's images/, with "/".
        time_s: of the clip's clock, or since 1970 where a photograph tells; None = unknown.
        latitude, longitude: degrees, where the photograph tells.
    """

    camera: str
    name: str
    number: int
    file: str
    time_s: float | None = None
    latitude: float | None = None
    longitude: float | None = None


@dataclass(frozen=True)
class Reel:
    """All frames of one camera.

    Attributes:
        camera: its name.
        source: the clip or folder.
        size: width, height of its frames as they are shown, pixels.
        bits: of a channel.
        frames: in the order of time.
        focal_px: that the files note, pixels; None = they note none. focal_source: what notes it.
        begun: seconds since 1970 of the first frame, where the clip tells; None = unknown.
        notices: what a user should know, one line each.
    """

    camera: str
    source: str
    size: tuple[int, int]
    bits: int
    frames: tuple[FootageFrame, ...]
    focal_px: float | None = None
    focal_source: str = ""
    begun: float | None = None
    notices: tuple[str, ...] = ()


def own_names(reels: Sequence[Reel]) -> dict[str, str]:
    """By the file of each frame a name that any program reads: those of photographs have spaces and more, at which lists of COLMAP
    are cut."""
    files = [f.file for r in reels for f in r.frames]
    return {file: f"{k:06d}{Path(file).suffix.lower()}" for k, file in enumerate(files)}


def write_reel(reel: Reel, path: Path) -> None:
    """Keep a reel as JSON."""
    write_json_atomic(path, asdict(reel))


def read_reel(path: Path) -> Reel:
    """Inverse of :func:`write_reel`.

    Raises:
        DriveError: the file is damaged.
    """
    held: Any = read_json(path)
    try:
        frames = tuple(FootageFrame(**f) for f in held.pop("frames"))
        size = (int(held["size"][0]), int(held["size"][1]))
        return Reel(**{**held, "frames": frames, "size": size, "notices": tuple(held["notices"])})
    except (TypeError, KeyError, ValueError, AttributeError, IndexError) as error:
        raise DriveError("Damaged", path=path, mend="delete it and run again") from error
