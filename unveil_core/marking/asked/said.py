"""What a person said of objects, in words of the command or in a file: clicks, strokes and mattes, in pixels of the footage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.files import read_json
from unveil_core.base.pictures.decoding import read_values
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Frame
from unveil_core.drives.marked import files_named

__all__ = ["Said", "SaidObject", "clicked", "drawn", "line_drawn", "of_file", "of_folder", "painted_pixels"]

CLICK = "as 0007:640,360, or CAMERA/0007:640,360: the frame, and the pixel from the upper left corner"
STROKE = "as 0007:stroke.png, or a file of strokes as docs/masks.md shows it"
BRUSH_PX = 0.01
"""Width of a stroke that says none, a share of the picture's width."""
MOST_PLACES = 100_000
"""In a file of strokes."""
LONGEST_NAME, FARTHEST = 200, 1e6
"""Of an object, letters; of a place from the picture's corner, pixels."""
MOST_THICK = 32_000
"""Pixels; OpenCV draws no thicker lines."""


@dataclass(frozen=True)
class Said:
    """One thing said of an object.

    Attributes:
        frame: as the person names it.
        what: "inside" or "outside", a click (x, y); "line", a stroke (width, [(x, y), …]); "stroke" or "matte", a picture;
            "mattes", a folder of such, of frames by their names.
        value: that.
        of: what places are counted in: "footage", its pixels; or "camera", shares from 0 to 1 of the picture without its lens.
    """

    frame: str
    what: str
    value: Any
    of: str = "footage"


@dataclass
class SaidObject:
    """What was said of one object in one go; ``name`` None where none was given."""

    name: str | None
    said: list[Said] = field(default_factory=list)


def clicked(text: str, what: str) -> Said:
    """A click in the words of the command, FRAME:X,Y; ``what``: "inside" or "outside".

    Raises:
        SettingsError: it is none.
    """
    frame, _, place = text.rpartition(":")
    try:
        x, y = (float(part) for part in place.split(","))
    except ValueError:
        x = y = math.nan
    if not frame or not (math.isfinite(x) and math.isfinite(y)):
        raise SettingsError(f"Not a click: {text!r}", mend=CLICK)
    return Said(frame.strip(), what, (x, y))


def drawn(text: str, what: str) -> Said:
    """A picture in the words of the command, FRAME:FILE; ``what``: "strokes" or "mattes".

    Raises:
        SettingsError: it is none.
    """
    frame, _, file = text.partition(":")
    if not frame or not file:
        raise SettingsError(f"Not a stroke: {text!r}", mend=STROKE)
    path = Path(file).expanduser().absolute()
    if not path.is_file():
        raise SettingsError("Not found", path=path, mend="name a picture that is white where the object is")
    return Said(frame.strip(), what, path)


def of_folder(text: str) -> Said:
    """A folder of mattes in the words of the command.

    Raises:
        SettingsError: there is none, or it holds no pictures.
    """
    folder = Path(text).expanduser().absolute()
    if not folder.is_dir():
        raise SettingsError(
            "Not found", path=folder, mend="name a folder of pictures that are white where the object is"
        )
    try:
        found = files_named(folder)
    except DriveError as error:
        raise SettingsError(error.problem, path=folder, mend="name a folder of mattes alone") from error
    if not found:
        raise SettingsError("Not mattes: it holds no pictures", path=folder, mend="name a folder of PNG files")
    return Said("", "mattes", folder)


def of_file(path: Path) -> list[SaidObject]:
    """The clicks and strokes of a file: a list of ``{object, frame, inside, outside, stroke, width, of}``.

    Raises:
        SettingsError: it holds no such list.
    """
    found: dict[str | None, SaidObject] = {}
    try:
        entries = read_json(path)
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise ValueError("no list of objects")
        for entry in entries:
            name = _name(entry.get("object"))
            thing = found.setdefault(name, SaidObject(name))
            frame, of = str(entry["frame"]), str(entry.get("of", "footage"))
            if of not in ("footage", "camera"):
                raise ValueError(f"of is footage or camera, not {of[:40]!r}")
            for what in ("inside", "outside"):
                thing.said += [Said(frame, what, place, of) for place in _places(entry.get(what, []))]
            if entry.get("stroke"):
                width = float(entry.get("width") or 0.0)
                if not (math.isfinite(width) and width >= 0):
                    raise ValueError(f"a width is a number of pixels, not {width}")
                thing.said.append(Said(frame, "line", (width, _places(entry["stroke"])), of))
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        problem = f"Not a file of strokes: {error}"
        mend = 'a list of {"object": "car", "frame": "0007", "inside": [[x, y]], "stroke": [[x, y], …]}'
        raise SettingsError(problem, path=path, mend=mend) from error
    return list(found.values())


def _name(given: Any) -> str | None:
    if given is not None and not (isinstance(given, str) and len(given) <= LONGEST_NAME):
        raise ValueError(f"object is a name of at most {LONGEST_NAME} letters")
    return given


def _places(given: Any) -> list[tuple[float, float]]:
    if not isinstance(given, list) or len(given) > MOST_PLACES:
        raise ValueError("places are a list of [x, y]")
    places = [(float(x), float(y)) for x, y in given]
    if not (np.abs(np.array(places)) <= FARTHEST).all():
        raise ValueError("places are numbers, in or near the picture")
    return places


def painted_pixels(path: Path, frame: Frame) -> Mask:
    """(h, w) of the footage, what a picture of a stroke or matte paints: its opaque part where it has transparency, else its white.

    Raises:
        DriveError: it cannot be read.
    """
    assert frame.footage is not None
    size = (frame.footage.camera.width, frame.footage.camera.height)
    values = read_values(path, None)
    pixels: Any = values.pixels if values.palette is None else values.palette[values.pixels]
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    if pixels.ndim == 3 and pixels.shape[2] == 4 and np.ptp(pixels[..., 3]):
        levels = pixels[..., 3]
    else:
        levels = pixels if pixels.ndim == 2 else pixels[..., :3].max(axis=2)
    if pixels.ndim == 2 and levels.max(initial=0) <= 1:
        levels = levels * 255  # a picture of 0 and 1
    if levels.shape != size[::-1]:
        levels = cv2.resize(levels.astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    return np.asarray(levels > 127)


def line_drawn(width: float, places: Sequence[tuple[float, float]], frame: Frame) -> Mask:
    """(h, w) of the footage, pixels under a stroke; it is no wider than the picture."""
    assert frame.footage is not None
    camera = frame.footage.camera
    mask = np.zeros((camera.height, camera.width), np.uint8)
    thick = max(1, round(min(width or BRUSH_PX * camera.width, camera.width, MOST_THICK)))
    way = np.round(np.clip(np.array(places), -1e4, 1e5) - 0.5).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(mask, [way], False, 1, thick)
    return mask.astype(bool)
