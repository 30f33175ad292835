"""Which files of a folder are its transforms.json: one, or the parts of a capture that was split to train and to test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json

__all__ = ["has_transforms", "parts_of"]

WHOLE = "transforms.json"
SPLITS = ("transforms_train.json", "transforms_val.json", "transforms_test.json")


def has_transforms(folder: Path) -> bool:
    """Whether a folder holds such files, by their names."""
    return any((folder / name).is_file() for name in (WHOLE, *SPLITS))


def parts_of(path: Path) -> tuple[list[tuple[Path, dict[str, Any]]], list[str]]:
    """The files that are read with what they hold, each with frames, and what a user should know of them.

    Args:
        path: a file, or the folder that holds it.
    Raises:
        DriveError: one is no JSON, or has no frames.
    """
    files = [path / name for name in SPLITS if (path / name).is_file()]
    if files and not (path / WHOLE).is_file():
        parts = [(file, _read(file)) for file in files]
        counts = ", ".join(f"{file.name} ({len(top['frames'])})" for file, top in parts)
        return parts, [f"no {WHOLE}: the frames of {counts} make one drive"] if len(parts) > 1 else []
    path = path / WHOLE if path.is_dir() else path
    notices = []
    if path.name in SPLITS:
        beside = [n for n in SPLITS if n != path.name and (path.parent / n).is_file()]
        notices = [f"{', '.join(beside)} beside it: not read; give the folder to read all frames"] if beside else []
    return [(path, _read(path))], notices


def _read(path: Path) -> dict[str, Any]:
    top: Any = read_json(path)
    if not isinstance(top, dict) or not isinstance(top.get("frames"), list) or not top["frames"]:
        raise DriveError("has no frames", path=path, mend="a drive needs at least one frame")
    return top
