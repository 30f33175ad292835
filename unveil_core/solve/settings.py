"""Settings of a solve."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.drive_options import frame_numbers
from unveil_core.base.errors import SettingsError

__all__ = ["LENSES", "SolveSettings", "focal_of", "focal_of_film"]

LENSES = ("simple", "opencv", "fisheye")
"""One radial term; OpenCV's two radial and two tangential ones; a fisheye's four."""
FULL_FRAME_MM = 43.27
"""Diagonal of the film that lengths "as of 35 mm" are told for."""
HEIGHTS_M = (0.05, 200.0)
SPEEDS_KMH = (0.1, 400.0)


def focal_of(text: str, size: tuple[int, int]) -> float:
    """Focal length in pixels of "1450" (pixels) or "26mm" (as of 35 mm film) for pictures of a size.

    Raises:
        SettingsError: it is neither.
    """
    found = re.fullmatch(r"\s*(\d{1,6}(?:\.\d{1,6})?)\s*(px|mm)?\s*", text)
    value = float(found[1]) if found else 0.0
    if found is None or value <= 0:
        raise SettingsError(f"Not a focal length: {text!r}", mend="give pixels, as 1450, or 26mm as of 35 mm film")
    return focal_of_film(value, size) if found[2] == "mm" else value


def focal_of_film(length_mm: float, size: tuple[int, int]) -> float:
    """Pixels of a focal length "as of 35 mm": by the diagonal, as makers of cameras count (CIPA DCG-001)."""
    return length_mm / FULL_FRAME_MM * math.hypot(*size)


@dataclass(frozen=True)
class SolveSettings:
    """What is known of footage, and how it is to be solved.

    Attributes:
        frames: "A:B:STEP" as in Python, counted from 0: the part that is solved and delivered; None = all.
        every: each so many-th of these frames alone.
        labels: folder of label pictures (Cityscapes trainIds), by frame; None = none.
        masks: folder of masks, 0 = remove, by frame; None = none.
        segmenter: path of an ONNX file that labels the frames; None = none.
        lens: one of ``LENSES``.
        focal: "1450" in pixels or "26mm" as of 35 mm film; None = of the files' notes, else found.
        camera_height: of the cameras above the ground, metres; None = unknown.
        speed: mean speed over the clip, km/h; None = unknown.
        known_length: of the way from the first to the last frame, metres; None = unknown.
        gpx: path of a GPX track of the drive; None = none.
        thorough: more features: three times the points, in three times the time.
        replace: whether a folder that another solve wrote may be written anew.

    Raises:
        SettingsError: a value out of range.
    """

    frames: str | None = None
    every: int = 1
    labels: Path | None = None
    masks: Path | None = None
    segmenter: Path | None = None
    lens: str = "simple"
    focal: str | None = None
    camera_height: float | None = None
    speed: float | None = None
    known_length: float | None = None
    gpx: Path | None = None
    thorough: bool = False
    replace: bool = False

    def __post_init__(self) -> None:
        if self.frames is not None:
            frame_numbers(self.frames, 0)
        if self.every < 1:
            raise SettingsError(f"Not a step: --every {self.every}", mend="give 1 or more")
        if self.lens not in LENSES:
            raise SettingsError(f"Not a lens: {self.lens!r}", mend=f"use one of {', '.join(LENSES)}")
        if self.focal is not None:
            focal_of(self.focal, (4, 3))
        if self.labels is not None and self.segmenter is not None:
            raise SettingsError(
                "Given twice: labels, from a folder and from a network", mend="give --labels or --segmenter"
            )
        for name, value, (least, most), unit in (
            ("camera-height", self.camera_height, HEIGHTS_M, "metres"),
            ("speed", self.speed, SPEEDS_KMH, "km/h"),
            ("known-length", self.known_length, (0.1, 1e6), "metres"),
        ):
            if value is not None and not (math.isfinite(value) and least <= value <= most):
                raise SettingsError(f"Not a value of --{name}: {value:g}", mend=f"give {least:g} to {most:g} {unit}")
        scales = ("camera_height", "speed", "known_length", "gpx")
        given = [f"--{n.replace('_', '-')}" for n in scales if getattr(self, n) is not None]
        if len(given) > 1:
            raise SettingsError(f"Given twice: the scale, by {' and '.join(given)}", mend="give one of them")
