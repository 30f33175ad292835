"""Depth images of a transforms.json as sweeps: one a frame, read when it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import load_npy
from unveil_core.base.errors import DriveError
from unveil_core.base.files import NO_ARCHIVE
from unveil_core.base.pictures.decoding import read_unchanged
from unveil_core.base.types import Float32, Float64
from unveil_core.drives.drive import Distortion, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import FISHEYE

__all__ = ["assumed_unit", "coarse_points", "depth_points", "depth_sweeps"]

MILLIMETRES = 1e-3
"""nerfstudio's unit of depth images where nothing else is given, metres."""
METRES_BELOW = 200.0
"""Depths in floating point with a smaller median are metres: as millimetres the whole street would lie before the bumper."""
MOST_POINTS = 150_000
"""Of one depth image, as many as of one turn of a LiDAR; more are thinned on its grid."""
EDGE = 0.1
"""Depths whose neighbours differ by more than this share are left out: at the borders of objects they are of neither side."""
COARSE_SWEEPS, COARSE_POINTS = 8, 2000
"""Depth images, and points of each, by which scale and up are estimated."""
WIDEST = 6.0
"""Points farther from the optical axis than this times their depth are not used: 80 degrees, where few fisheyes are calibrated."""


def depth_sweeps(frames: Sequence[Frame], depth_step: float) -> tuple[Sweep, ...]:
    """A sweep of each frame whose depth file is there, its boxes those of the frame.

    Args:
        depth_step: of the values, in units of the drive.
    """
    return tuple(
        _sweep(f, f.depth_path, depth_step) for f in frames if f.depth_path is not None and f.depth_path.is_file()
    )


def _sweep(frame: Frame, path: Path, depth_step: float) -> Sweep:
    def read() -> SweepPoints:
        return depth_points(path, frame.camera, frame.distortion, depth_step)

    return Sweep(path, read, frame.timestamp, frame.boxes)


def assumed_unit(path: Path) -> float:
    """Metres a step of a depth image that nothing is said of: millimetres, but of small floating point numbers metres.

    Raises:
        DriveError: an .npy file that is none. Others are not opened.
    """
    if path.suffix.lower() != ".npy":
        return MILLIMETRES
    values = _load_npy(path)
    if values.dtype.kind != "f":
        return MILLIMETRES
    some = np.asarray(values[::4, ::4])
    some = some[np.isfinite(some) & (some > 0)]
    return 1.0 if len(some) and np.median(some) < METRES_BELOW else MILLIMETRES


def coarse_points(sweeps: Sequence[Sweep]) -> PointCloud:
    """A few points of a few sweeps, for estimates before any import.

    Raises:
        DriveError: one of them cannot be read.
    """
    found = []
    for sweep in sweeps[:: -(-len(sweeps) // COARSE_SWEEPS)]:
        positions = sweep.read().positions
        found.append(positions[:: max(1, len(positions) // COARSE_POINTS)])
    return PointCloud(np.concatenate(found))


def depth_points(path: Path, camera: Camera, distortion: Distortion | None, depth_step: float) -> SweepPoints:
    """The points of a depth image along the optical axis, in the coordinates of the drive.

    Args:
        path: a PNG or TIFF of one channel with 16 bits or more, or an .npy; 0, NaN and infinity are unknown.
        camera, distortion: of the frame; the image may be smaller than the photograph.
        depth_step: of the values, in units of the drive.
    Raises:
        DriveError: it is none.
    """
    depth = _read_depth(path) * np.float32(depth_step)
    height, width = depth.shape
    good = _away_from_edges(depth)
    step = max(1, int(np.ceil(np.sqrt(good.sum() / MOST_POINTS))))
    rows, columns = np.nonzero(good[::step, ::step])
    rows, columns = rows * step, columns * step
    pixels = np.stack([(columns + 0.5) * (camera.width / width), (rows + 0.5) * (camera.height / height)], axis=1)
    rays = _rays(pixels, camera, distortion)
    inside = np.isfinite(rays).all(axis=1) & (np.abs(rays) < WIDEST).all(axis=1)
    far = depth[rows, columns].astype(np.float64)[inside, None]
    local = np.concatenate([rays[inside], np.ones((int(inside.sum()), 1))], axis=1) * far
    pose = camera.camera_to_world
    return SweepPoints(local @ pose[:3, :3].T + pose[:3, 3])


def _rays(pixels: Float64, camera: Camera, distortion: Distortion | None) -> Float64:
    """(P, 2) x / z and y / z of pixels (P, 2), counted from the outer edge of the first."""
    if distortion is None or not len(pixels):
        return (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    coefficients = np.array(distortion.coefficients, dtype=np.float64)
    undistort = cv2.fisheye.undistortPoints if distortion.model == FISHEYE else cv2.undistortPoints
    return np.asarray(undistort(pixels[:, None], k, coefficients)).reshape(-1, 2)


def _away_from_edges(depth: Float32) -> NDArray[np.bool_]:
    """(H, W) depths that are known, and do not jump to one of the four neighbours that are known."""
    good = np.isfinite(depth) & (depth > 0)
    kept = good.copy()
    for axis in (0, 1):
        near, far = (depth[:-1], depth[1:]) if axis == 0 else (depth[:, :-1], depth[:, 1:])
        known = (good[:-1] & good[1:]) if axis == 0 else (good[:, :-1] & good[:, 1:])
        with np.errstate(invalid="ignore"):
            jump = known & (np.abs(near - far) > EDGE * np.minimum(near, far))
        if axis == 0:
            kept[:-1] &= ~jump
            kept[1:] &= ~jump
        else:
            kept[:, :-1] &= ~jump
            kept[:, 1:] &= ~jump
    return kept


def _load_npy(path: Path) -> NDArray[np.generic]:
    """An array of one channel."""
    try:
        values: NDArray[np.generic] = load_npy(path, links=True)
    except NO_ARCHIVE as error:
        raise DriveError(f"Not a readable .npy file: {error}", path=path, mend="save it as a plain array") from error
    values = values[..., 0] if getattr(values, "ndim", 0) == 3 and values.shape[2] == 1 else values
    if getattr(values, "ndim", 0) != 2 or values.dtype.kind not in "fiu" or not values.size:
        raise DriveError("Not an array (H, W) of depths", path=path, mend="save one depth a pixel")
    return values


def _read_depth(path: Path) -> Float32:
    """(H, W) as the file has it."""
    if path.suffix.lower() == ".npy":
        return np.array(_load_npy(path), dtype=np.float32)
    try:
        image = read_unchanged(path)
    except DriveError as error:
        problem = error.problem.replace("readable image", "readable depth image")
        raise DriveError(problem, path=path, mend="export it again as 16-bit PNG or .npy") from error
    if image.ndim != 2 or image.dtype == np.uint8:
        shape = f"{image.shape[2]} channels" if image.ndim == 3 else "8 bits"
        raise DriveError(
            f"Not a depth image of one channel: it has {shape}",
            path=path,
            mend="export it as 16-bit PNG of one channel or .npy",
        )
    return np.asarray(image, dtype=np.float32)
