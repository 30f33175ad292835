"""Points of a drive in one of its photographs: whether they lie on what it shows is seen at a glance."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64, Picture
from unveil_core.drives.drive import Drive, Frame, Sweep, tracks
from unveil_core.drives.photographs import photograph
from unveil_core.geometry.cloud import every_nth
from unveil_core.geometry.lens import distorted

__all__ = ["PointsPicture", "nearest_sweeps", "points_picture"]

WIDTH_PX = 1280
"""Of the picture at most."""
MOST_POINTS = 60_000
FEW_POINTS = 5000
"""In a picture; fewer are drawn larger."""
NEAR_M, FAR_M = 2.0, 60.0
"""Depths that are red and blue, metres."""


@dataclass(frozen=True, eq=False)
class PointsPicture:
    """A photograph with points over it, coloured by depth.

    Attributes:
        picture: (H, W, 3). camera, frame: its names. points: how many are drawn.
    """

    picture: Picture
    camera: str
    frame: str
    points: int


def points_picture(drive: Drive) -> PointsPicture | None:
    """Of the middle frame of a drive in metres; None where nothing of it can be read."""
    track = max(tracks(drive), key=len)
    frame = drive.frames[track[len(track) // 2]]
    clouds = [drive.points.positions] if len(drive.points.positions) else []
    if not clouds:
        for sweep in nearest_sweeps(drive, frame, 1):
            with suppress(DriveError):
                clouds.append(sweep.read().positions)
    with suppress(DriveError):
        picture, count = _drawn(photograph(frame), frame, np.concatenate([*clouds, np.zeros((0, 3))]))
        return PointsPicture(picture, frame.camera_name, frame.name, count)
    return None


def nearest_sweeps(drive: Drive, frame: Frame, count: int) -> list[Sweep]:
    """The sweeps of a drive nearest to a frame in time; where times are missing, in the order of both."""
    if not drive.sweeps:
        return []
    if frame.timestamp is not None and all(s.timestamp is not None for s in drive.sweeps):
        away = [abs((s.timestamp or 0.0) - frame.timestamp) for s in drive.sweeps]
    else:
        track = [f for f in drive.frames if f.camera_name == frame.camera_name]
        place = track.index(frame) / max(len(track) - 1, 1) * (len(drive.sweeps) - 1)
        away = [abs(k - place) for k in range(len(drive.sweeps))]
    return [drive.sweeps[k] for k in np.argsort(away, kind="stable")[:count]]


def _drawn(image: Picture, frame: Frame, points: Float64) -> tuple[Picture, int]:
    """The photograph, reduced, with the points that it shows; and how many these are."""
    camera = frame.camera
    local = every_nth(points, 10 * MOST_POINTS) @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    local = local[local[:, 2] > 0.1]
    flat = local[:, :2] / local[:, 2:]
    # What a lens bends back into the picture from beside it is not there.
    widest = max(camera.cx, camera.width - camera.cx) / camera.fx, max(camera.cy, camera.height - camera.cy) / camera.fy
    near = (np.abs(flat) <= 1.5 * np.array(widest)).all(axis=1)
    local, flat = local[near], flat[near]
    lens = frame.distortion
    seen = flat if lens is None else distorted(lens.model, lens.coefficients, flat)
    pixels = seen * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    inside = (pixels >= 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1)
    order = np.argsort(-local[inside, 2], kind="stable")  # near ones over far ones
    pixels, depth = pixels[inside][order], local[inside, 2][order]
    scale = min(1.0, WIDTH_PX / camera.width)
    size = (round(camera.width * scale), round(camera.height * scale))
    shown = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1 else image.copy()
    step = max(1, -(-len(pixels) // MOST_POINTS))
    share = np.log(depth.clip(NEAR_M, FAR_M) / NEAR_M) / np.log(FAR_M / NEAR_M)
    colours = cv2.applyColorMap((255 - 255 * share).astype(np.uint8)[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]
    radius = (0 if size[0] < 600 else 1) + 2 * (len(pixels) < FEW_POINTS)
    for (x, y), colour in zip((pixels[::step] * scale).astype(int).tolist(), colours[::step].tolist(), strict=True):
        cv2.circle(shown, (x, y), radius, colour, -1)
    return shown.astype(np.uint8), len(pixels)
