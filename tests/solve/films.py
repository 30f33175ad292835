"""Small films: a part of the sample clip with its truth, and pictures that a codec keeps."""

from __future__ import annotations

import json
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

SAMPLE = Path(__file__).parents[2] / "sample_scenes/phone_clip"
COUNT, STEP, SIZE = 16, 3, (480, 270)
"""Frames of the sample clip that are taken, each so many-th, and their size."""


@cache
def frames() -> tuple[np.ndarray, ...]:
    """Pictures (H, W, 3) RGB, a metre apart."""
    av = pytest.importorskip("av")
    found = []
    with av.open(str(SAMPLE / "clip.mp4")) as container:
        for k, frame in enumerate(container.decode(video=0)):
            if k % STEP == 0 and len(found) < COUNT:
                found.append(cv2.resize(frame.to_ndarray(format="rgb24"), SIZE, interpolation=cv2.INTER_AREA))
            if len(found) == COUNT:
                break
    return tuple(found)


def truth() -> tuple[float, float, np.ndarray]:
    """Focal length in pixels, height of the camera in metres, and (N, 4, 4) camera to world with OpenCV axes."""
    told = json.loads((SAMPLE / "truth.json").read_text())
    poses = np.array(told["camera_to_world"])[: COUNT * STEP : STEP]
    return told["focal_px"] * SIZE[0] / told["width"], told["camera_height"], poses


def write_frames(folder: Path, pictures: list[np.ndarray]) -> Path:
    """Pictures as PNGs by number."""
    folder.mkdir(parents=True)
    for k, rgb in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:04d}.png"), rgb[..., ::-1])
    return folder


def write_labels(folder: Path) -> Path:
    """The labels of :func:`frames` by number."""
    folder.mkdir(parents=True)
    for k in range(COUNT):
        kinds = cv2.imread(str(SAMPLE / f"labels/{k * STEP:06d}.png"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(folder / f"{k:04d}.png"), cv2.resize(kinds, SIZE, interpolation=cv2.INTER_NEAREST))
    return folder


def write_clip(path: Path, pictures: list[np.ndarray], times: list[float] | None = None, **how: Any) -> Path:
    """Pictures as a clip.

    Args:
        times: of each, seconds; None = ten a second.
        how: codec, pixels (the layout), rate and options of the encoder; format, where the name does not tell it; title.
    """
    import av

    options: dict[str, str] = how.get("options", {"crf": "12"})
    with av.open(str(path), "w", format=how.get("format")) as container:
        if "title" in how:
            container.metadata["title"] = str(how["title"])
        rate = Fraction(how.get("rate", 10))
        stream = container.add_stream(str(how.get("codec", "libx264")), rate=rate, options=options)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = str(how.get("pixels", "yuv420p"))
        if "rate" not in how:
            stream.codec_context.time_base = Fraction(1, 600)
        for k, rgb in enumerate(pictures):
            kind = "rgb48le" if rgb.dtype == np.uint16 else "rgb24"
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format=kind).reformat(format=stream.pix_fmt)
            frame.pts, frame.time_base = round(600 * (times[k] if times else k / rate)), Fraction(1, 600)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def smooth_pictures(count: int, size: tuple[int, int] = (96, 64)) -> list[np.ndarray]:
    """Pictures that a codec keeps: a gradient with a square that tells the number."""
    width, height = size
    across, down = np.linspace(40, 160, width)[None], np.linspace(60, 120, height)[:, None]
    base = np.stack(np.broadcast_arrays(across, down, 90.0), axis=-1)
    found = []
    for k in range(count):
        shown = base.copy()
        shown[4:20, 4:20] = (20 * k) % 240
        found.append(shown.astype(np.uint8))
    return found
