"""Corrections of clean frames, as a file lists them.

A JSON list; each entry is ``{camera, frame, image: FILE.png}``. The image has transparency and the size of the delivered frame:
where it is opaque, its colours replace the frame's. With ``"over": FILE.png`` it needs no transparency: it counts where it differs
from that file, which was painted over. With ``"invent": true`` its colours do not count: what it covers is invented anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.pictures.decoding import read_image_as_it_is
from unveil_core.base.types import Float32
from unveil_core.drives.drive import Frame

__all__ = ["Correction", "corrections_of", "read_corrections", "read_paint"]

SAME = 1.2 / 255
"""Change of a level, of 1, that a painting program makes by reading and writing a picture; twice as much counts in full."""
MEND = "an entry is {camera, frame, image: FILE.png}, the image with transparency"


@dataclass(frozen=True)
class Correction:
    """One corrected frame.

    Attributes:
        camera, frame: names of its track and of itself.
        image: the file; over: the one that was painted over, None where the image has transparency.
        invent: whether what it covers is invented anew, instead of taking its colours.
    """

    camera: str
    frame: str
    image: Path
    over: Path | None = None
    invent: bool = False

    @property
    def files(self) -> tuple[Path, ...]:
        """All files of it."""
        return (self.image,) if self.over is None else (self.image, self.over)


def read_corrections(path: Path) -> tuple[Correction, ...]:
    """The checked corrections of a file; images are relative to it.

    Raises:
        DriveError: no such file, not a list, an entry that is none, or a frame that is corrected twice.
    """
    entries = read_json(path)
    if not isinstance(entries, list):
        raise DriveError("holds no list of corrections", path=path, mend=MEND)
    found = [_entry(i, entry, path) for i, entry in enumerate(entries)]
    places = [(c.camera, c.frame) for c in found]
    twice = next((place for place in places if places.count(place) > 1), None)
    if twice is not None:
        raise DriveError(
            f"frame {twice[1]} of camera {twice[0]} is corrected twice", path=path, mend="keep one of them"
        )
    return tuple(found)


def corrections_of(setting: str | None) -> tuple[Correction, ...]:
    """Those of the file that a run's settings name; none where they name none."""
    return () if setting is None else read_corrections(Path(setting))


def _entry(i: int, entry: Any, path: Path) -> Correction:
    if not isinstance(entry, dict) or not all(isinstance(entry.get(k), str) for k in ("camera", "frame", "image")):
        raise DriveError(f"Not a correction: entry {i}", path=path, mend=MEND)
    if not isinstance(entry.get("invent", False), bool):
        raise DriveError(f"entry {i}: invent is neither true nor false", path=path, mend=MEND)
    image = named_path(path.parent, entry["image"], path, f"image of entry {i}")
    over = None
    if entry.get("over") is not None:
        over = named_path(path.parent, entry["over"], path, f"over of entry {i}")
    return Correction(entry["camera"], entry["frame"], image, over, entry.get("invent", False))


def read_paint(correction: Correction, frame: Frame) -> Float32:
    """(H, W, 4) float32 in [0, 1]: colours as the frame's photograph would show them, and how far they cover it.

    Args:
        frame: that is corrected.
    Raises:
        DriveError: the image is missing or damaged, has no transparency, or another size than the frame's.
    """
    camera = frame.camera if frame.footage is None else frame.footage.camera
    planes = [_read(path, frame.name, camera.width, camera.height) for path in correction.files]
    if correction.over is None:
        if planes[0].shape[2] != 4:
            raise DriveError("has no transparency that tells what was painted", path=correction.image, mend=MEND)
        return planes[0]
    color, before = (_color(plane) for plane in planes)
    change = np.abs(color - before).max(axis=2)
    cover = np.clip((change - SAME) / SAME, 0, 1)
    return np.dstack([color, cover]).astype(np.float32)


def _read(path: Path, name: str, width: int, height: int) -> Float32:
    """(H, W, C) in [0, 1]."""
    picture: NDArray[np.uint8] | NDArray[np.uint16] = read_image_as_it_is(path)
    if picture.shape[:2] != (height, width):
        raise DriveError(
            f"Not the size of frame {name}: {picture.shape[1]}x{picture.shape[0]} pixels, the frame has {width}x{height}",
            path=path,
            mend="paint on the delivered frame at its own size",
        )
    return np.atleast_3d(picture).astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)


def _color(plane: Float32) -> Float32:
    return plane[..., :3] if plane.shape[2] >= 3 else plane[..., :1].repeat(3, axis=2)
