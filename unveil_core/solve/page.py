"""The page of a solve: one HTML file that needs nothing but itself."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, StrictUndefined
from numpy.typing import NDArray

from unveil_core.base.output.written import GENERATOR
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Float64, Picture
from unveil_core.drives.drive import PointCloud
from unveil_core.solve.footage.frames import Reel
from unveil_core.solve.mapping.model import Model

__all__ = ["solve_page"]

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""What a browser lets the page do: show pictures that are in it."""
MAP_PX, SHOWN_PX = 1100, 900
"""Longer sides of the map and of frames, pixels."""
AROUND_M = 15.0
"""Beside the way, that is shown."""
BARS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
CELLS = (16, 9)
"""Fields of a frame in which observations are counted."""
COLOURS = ("#5cc3ab", "#f08c32", "#568cf5", "#d9ae62", "#a79de0", "#e65a6e")


def solve_page(model: Model, reels: Sequence[Reel], points: PointCloud, facts: dict[str, Any], images: Path) -> str:
    """The page as text.

    Args:
        model: in metres with z up; points: likewise.
        facts: as ``solve.json`` has them; images: folder of the frames.
    """
    template = files("unveil_core.solve").joinpath("page.html.j2").read_text(encoding="utf-8")
    made = Environment(autoescape=True, undefined=StrictUndefined).from_string(template)
    return made.render(
        policy=POLICY,
        generator=GENERATOR,
        facts=facts,
        map=_map(model, reels, points),
        cameras=[_camera(model, reel, images, facts) for reel in reels],
    )


def _map(model: Model, reels: Sequence[Reel], points: PointCloud) -> dict[str, Any]:
    """The way from above, first camera first, from left to right."""
    centres = model.centres
    along = centres[-1, :2] - centres[0, :2]
    if np.linalg.norm(along) < 1e-6:
        along = np.array([1.0, 0.0])
    along = along / np.linalg.norm(along)
    turn = np.array([along, [-along[1], along[0]]]).T
    level = centres[:, :2] @ turn
    low, high = level.min(axis=0) - AROUND_M, level.max(axis=0) + AROUND_M
    scale = MAP_PX / max(high - low)
    width, height = (int(np.ceil(v)) for v in (high - low) * scale)

    def pixel(places: Float64) -> Float64:
        at = (places - low) * scale
        return np.stack([at[:, 0], height - at[:, 1]], axis=1)

    picture = np.full((height, width, 3), (43, 48, 56), np.uint8)
    at = pixel(points.positions[:, :2] @ turn).astype(np.int64)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    order = np.argsort(points.positions[inside, 2], kind="stable")  # what is higher hides what is below
    at = at[inside][order]
    picture[at[:, 1], at[:, 0]] = 200 if points.colors is None else points.colors[inside][order]
    number = {n: i for i, n in enumerate(model.names)}
    lines = []
    for k, reel in enumerate(reels):
        own = [number[f.file] for f in reel.frames if f.file in number]
        shown = " ".join(f"{x:.1f},{y:.1f}" for x, y in pixel(level[own]))
        lines.append({"name": reel.camera, "points": shown, "colour": COLOURS[k % len(COLOURS)]})
    start = pixel(level[[number[f.file] for f in reels[0].frames if f.file in number][:1]])[0]
    bar = next((b for b in BARS_M if b * scale > 80), BARS_M[-1])
    return {
        "width": width,
        "height": height,
        "picture": _uri(picture),
        "lines": lines,
        "start": [f"{v:.1f}" for v in start],
        "bar": {"px": f"{bar * scale:.1f}", "words": f"{bar} m"},
    }


def _camera(model: Model, reel: Reel, images: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Errors of a camera's frames, what they show, and one of them with its points."""
    errors = model.frame_errors()
    number = {n: i for i, n in enumerate(model.names)}
    bars: list[dict[str, Any]] = []
    counts = np.zeros(CELLS[::-1])
    best, most = None, -1
    for frame in reel.frames:
        i = number.get(frame.file)
        if i is None:
            bars.append({"error": None, "seen": 0, "name": frame.name, "kind": "lost"})
            continue
        own = model.pixels[model.seen_by == i]
        if len(own):
            cells = (own / reel.size * CELLS).astype(int).clip(0, np.array(CELLS) - 1)
            np.add.at(counts, (cells[:, 1], cells[:, 0]), 1)
        if len(own) > most:
            best, most = frame, len(own)
        error = None if np.isnan(errors[i]) else round(float(errors[i]), 2)
        bars.append({"error": error, "seen": len(own), "name": frame.name, "kind": "solved" if error else "followed"})
    top = max([b["error"] for b in bars if b["error"]] or [1.0])
    seen = max([b["seen"] for b in bars] or [1]) or 1
    for b in bars:
        b["high"] = f"{100 * (b['error'] or 0) / top:.1f}"
        b["many"] = f"{100 * b['seen'] / seen:.1f}"
    assert best is not None
    picture = read_image(images / best.file)
    own = model.pixels[model.seen_by == number[best.file]]
    return {
        "name": reel.camera,
        "bars": bars,
        "top": f"{top:.2f}",
        "seen": seen,
        "frame": best.name,
        "picture": _uri(_covered(picture, own, counts)),
        "lens": facts["lens"].get(reel.camera),
    }


def _covered(picture: Picture, pixels: Float64, counts: Float64) -> Picture:
    """A frame with its observations; fields in which few of all frames are, are darker."""
    scale = min(1.0, SHOWN_PX / max(picture.shape[:2]))
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    shown = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    share = np.clip(counts / max(1.0, float(np.percentile(counts, 90))), 0.25, 1.0).astype(np.float32)
    light = cv2.resize(share, size, interpolation=cv2.INTER_NEAREST)[..., None]
    shown = (shown * light).astype(np.uint8)
    for x, y in pixels * scale:
        cv2.circle(shown, (int(x), int(y)), 2, (92, 195, 171), -1, cv2.LINE_AA)
    return np.asarray(shown, np.uint8)


def _uri(picture: NDArray[np.uint8]) -> str:
    done, content = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80])
    assert done
    return "data:image/jpeg;base64," + b64encode(content.tobytes()).decode()
