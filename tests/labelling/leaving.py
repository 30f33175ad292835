"""The street of ``parked_row`` driven along until a parked and a moving car leave the picture, with boxes that can be spoilt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from tests.labelling.parked_row import POLE, SOLIDS, Solids, boxes, camera_at, picture, sweep_at
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep

PARKED, MOVING = 1, 4
COUNT, STEP_S, EGO_MS, MOVING_MS = 8, 0.1, 7.0, -8.0
"""Frames, seconds between them, and speeds along the street, metres a second."""
BUMPER_M, BUMPER_TOP_M, BUMPER_COLOR = 0.35, 0.75, (0.17, 0.18, 0.2)
"""How long the cars' bumpers are, how high they reach, and their colour, which is none of the cars'."""

Spoilt = Callable[[int, TrackedBox], TrackedBox | None]
"""What becomes of a box of the frame of a number; None = it is left out."""


def solids_at(time: float) -> Solids:
    """What stands in the street at a time, each object in one piece. The pole is left out: it would hide the moving car."""
    found = []
    for number, kind, low, high, color in SOLIDS:
        on = MOVING_MS * time if number == MOVING else 0.0
        if kind != POLE:
            found.append((number, kind, (low[0] + on, *low[1:]), (high[0] + on, *high[1:]), color))
    return tuple(found)


def with_bumpers(solids: Solids) -> Solids:
    """The two cars that leave the picture in three pieces."""
    found = []
    for number, kind, (x0, *low), (x1, y1, z1), color in solids:
        if number in (PARKED, MOVING):
            near, far = x0 + BUMPER_M, x1 - BUMPER_M
            found.append((number, kind, (x0, *low), (near, y1, BUMPER_TOP_M), BUMPER_COLOR))
            found.append((number, kind, (far, *low), (x1, y1, BUMPER_TOP_M), BUMPER_COLOR))
            x0, x1 = near, far
        found.append((number, kind, (x0, *low), (x1, y1, z1), color))
    return tuple(found)


def truth(frame: Frame) -> np.ndarray:
    """(H, W) ids that a frame shows."""
    return picture(frame.camera, with_bumpers(solids_at(frame.timestamp or 0.0)))[2]


def leaving(
    folder: Path,
    in_frames: Spoilt = lambda i, box: box,
    in_sweeps: Spoilt = lambda i, box: box,
    *,
    classes: bool = True,
    sweeps: tuple[int, ...] = tuple(range(COUNT)),
) -> Drive:
    """The drive, localized, its pictures in ``folder``, with sweeps at the times of some of its frames."""
    folder.mkdir(parents=True, exist_ok=True)
    frames, turns = [], []
    for i in range(COUNT):
        time = STEP_S * i
        camera, path, solids = camera_at(EGO_MS * time), folder / f"{i:02d}.png", with_bumpers(solids_at(time))
        cv2.imwrite(str(path), picture(camera, solids)[0][..., ::-1])
        whole = boxes(solids_at(time))
        found, held = (tuple(b for b in (of(i, b) for b in whole) if b) for of in (in_frames, in_sweeps))
        frames.append(Frame(f"{i:02d}", "front", camera, path, timestamp=time, boxes=found))
        if i in sweeps:
            points = sweep_at(EGO_MS * time, classes, solids)
            turns.append(Sweep(folder / f"{i:02d}", lambda points=points: points, time, held))  # type: ignore[misc]
    parts = [turn.read() for turn in turns]
    cloud = PointCloud(np.concatenate([p.positions for p in parts]), measured=True)
    if classes:
        cloud = replace(cloud, classes=np.concatenate([p.classes for p in parts if p.classes is not None]))
    return Drive(folder, tuple(frames), cloud, sweeps=tuple(turns))
