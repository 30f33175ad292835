"""Frames that a rolling shutter bends are told of before a solve."""

from __future__ import annotations

import numpy as np

from tests.solve.films import frames
from unveil_core.solve.footage.frames import FootageFrame
from unveil_core.solve.looks.motion import motion_of
from unveil_core.solve.looks.shutter import told_of_shutter
from unveil_core.solve.looks.thumbs import Thumbs


def panned(pixels: int, rate: float | None, count: int = 8) -> Thumbs:
    """A camera that turns by so many of 320 pixels from frame to frame, so many frames a second (None = without times)."""
    whole = frames()[0][..., 1]
    pictures = [np.ascontiguousarray(whole[:180, k * pixels : k * pixels + 320]) for k in range(count)]
    times = [None if rate is None else k / rate for k in range(count)]
    return Thumbs(tuple(FootageFrame("camera", f"{k}", 10 + k, f"{k}.png", times[k]) for k in range(count)), pictures)


def told(pixels: int, rate: float | None) -> str | None:
    thumbs = panned(pixels, rate)
    return told_of_shutter(thumbs, motion_of(thumbs))


def test_a_fast_turn_is_told_with_its_frames() -> None:
    line = told(20, 10.0)  # 62 % of the width a second, a fiftieth of it while a frame is read
    assert line is not None and line.startswith("the picture moves fast in 7 steps between the frames 10 and 17")
    assert "by up to 1.2 % of its width" in line or "by up to 1.3 % of its width" in line


def test_a_slow_turn_is_not_and_nor_are_frames_without_times() -> None:
    assert told(4, 10.0) is None
    assert told(20, None) is None
    assert told(20, 1.0) is None  # photographs: nobody knows how fast the camera moved between them
