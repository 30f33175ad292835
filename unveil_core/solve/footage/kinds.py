"""What a path is: a clip, a folder of photographs, or neither; by names alone."""

from __future__ import annotations

import re
from pathlib import Path

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import DriveError

__all__ = ["PICTURES", "VIDEOS", "files_of", "is_clip", "is_footage", "pictures_in"]

VIDEOS = (
    ".mp4",
    ".mov",
    ".m4v",
    ".avi",
    ".mkv",
    ".webm",
    ".mts",
    ".m2ts",
    ".ts",
    ".mpg",
    ".mpeg",
    ".mxf",
    ".3gp",
    ".wmv",
)
"""Suffixes of clips that FFmpeg decodes."""
PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
"""Suffixes of photographs that are read."""
FEWEST = 2


def is_clip(path: Path) -> bool:
    """Whether a path is a file that is called as a clip is."""
    return path.suffix.lower() in VIDEOS and path.is_file()


def pictures_in(folder: Path) -> list[Path]:
    """The photographs of a folder in the order of their names, numbers by value; of it alone, not of folders in it."""
    found = [p for p in folder.iterdir() if p.suffix.lower() in PICTURES and p.is_file() and p.name[0] != "."]
    return sorted(found, key=lambda p: natural_key(p.name))


def files_of(footage: Path) -> list[Path]:
    """The clip, or the photographs of a folder."""
    return [footage] if footage.is_file() else pictures_in(footage)


def is_footage(path: Path) -> bool:
    """Whether a path may be solved: a clip, or a folder with photographs in it and nothing that is a drive's.

    Whoever reads drives asks first whether it is one.
    """
    if is_clip(path):
        return True
    try:
        return path.is_dir() and len(pictures_in(path)) >= FEWEST
    except OSError:
        return False


def camera_names(inputs: list[Path]) -> list[str]:
    """A name for the camera of each input: one alone is "camera", several are called as their files are.

    Raises:
        DriveError: two inputs are of one name.
    """
    if len(inputs) == 1:
        return ["camera"]
    names = [
        re.sub(r"[^A-Za-z0-9_-]+", "_", p.stem if p.suffix.lower() in VIDEOS else p.name) or "camera" for p in inputs
    ]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise DriveError(f"Two cameras are called {twice}", mend="rename one of the clips or folders")
    return names
