"""Which files a truth consists of: those that are named like the drive's frames, and no other, wherever it lies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from unveil_core.base.errors import UnveilError
from unveil_core.drives.camera_path import read_camera_path
from unveil_core.drives.drive import Drive, Frame

__all__ = ["truth_file", "truth_files"]

FOLDERS = ("images", "removed", "unseen", "shadow", "depth", "semantics")
"""Of a truth, with a file for each frame."""
FREE_FOLDERS = {"images": (".png", ".jpg", ".jpeg"), "removed": (".png",), "unseen": (".png",)}
"""Of its ``free/``, with a file for each view; and their suffixes."""


def truth_file(folder: Path, frame: Frame) -> Path | None:
    """``<folder>/<camera>/<frame>.*`` before ``<folder>/<frame>.*``: drives of several cameras repeat frame names."""
    for parent in (folder / frame.camera_name, folder):
        for suffix in (".png", ".jpg", ".jpeg", ".PNG", ".JPG"):
            path = parent / f"{frame.name}{suffix}"
            if path.is_file():
                return path
    return None


def truth_files(truth: Path, drive: Drive) -> Iterator[Path]:
    """The files of a truth folder that an evaluation reads, in a fixed order.

    No folder is listed: a workspace of a stranger may name any folder of this machine as its truth.
    """
    for folder in (truth / name for name in FOLDERS):
        if folder.is_dir():
            yield from filter(None, (truth_file(folder, frame) for frame in drive.frames))
    cameras = truth / "free/transforms.json"
    if not cameras.is_file():
        return
    yield cameras
    try:
        views = read_camera_path(cameras, drive)
    except UnveilError:  # the evaluation says so
        return
    for name, suffixes in FREE_FOLDERS.items():
        for view in views:
            places = (truth / "free" / name / f"{view.name}{suffix}" for suffix in suffixes)
            yield from (path for path in places if path.is_file())
