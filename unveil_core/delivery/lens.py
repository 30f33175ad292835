"""Between a frame's footage and its picture of working size: which position of one shows what which position of the other does."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from threading import Lock

import numpy as np

from unveil_core.base.types import Float32, Float64
from unveil_core.drives.drive import Distortion, Footage
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import distorted, undistorted

__all__ = ["footage_positions", "picture_positions", "work_positions", "write_st_maps"]

_lock = Lock()
KEPT_LENSES = 4
"""Lenses whose positions are kept, 8 bytes a pixel: frames of a camera share one, and follow each other."""


def _normalized(positions: Float64, camera: Camera) -> Float64:
    return (positions - [camera.cx, camera.cy]) / [camera.fx, camera.fy]


def _in_pixels(normalized: Float64, camera: Camera) -> Float64:
    return normalized * [camera.fx, camera.fy] + [camera.cx, camera.cy]


def _centres(camera: Camera) -> Float64:
    """(H * W, 2) positions of the pixel centres."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def work_positions(footage: Footage, camera: Camera) -> Float32:
    """(H, W, 2) where the working picture shows what each pixel of the footage does; read-only.

    Args:
        footage: with its lens; camera: of the working picture, with the same pose.
    """
    with _lock:  # of threads that ask for one lens at once one finds its positions
        return _positions_of_lens(footage.camera.intrinsics, footage.distortion, camera.intrinsics)


@lru_cache(maxsize=KEPT_LENSES)
def _positions_of_lens(
    source: tuple[int, int, float, float, float, float],
    lens: Distortion | None,
    target: tuple[int, int, float, float, float, float],
) -> Float32:
    """See :func:`work_positions`; cameras by their numbers, for they are the same with any pose."""
    of_file, of_picture = Camera(*source, np.eye(4)), Camera(*target, np.eye(4))
    flat = _normalized(_centres(of_file), of_file)
    if lens is not None:
        flat = undistorted(lens.model, lens.coefficients, flat)
    found = _in_pixels(flat, of_picture).reshape(of_file.height, of_file.width, 2).astype(np.float32)
    found.flags.writeable = False
    return found


def picture_positions(footage: Footage, camera: Camera, work: Float32) -> Float32:
    """(…, 2) where the footage shows what its working picture shows at positions (…, 2): the inverse of :func:`work_positions`."""
    flat = _normalized(work.reshape(-1, 2).astype(np.float64), camera)
    if footage.distortion is not None:
        known = np.isfinite(flat[:, 0])
        lens = footage.distortion
        flat[known] = distorted(lens.model, lens.coefficients, flat[known])
    return _in_pixels(flat, footage.camera).reshape(work.shape).astype(np.float32)


def footage_positions(footage: Footage, points: Float64) -> tuple[Float64, Float64]:
    """Where the footage shows world points.

    Args:
        points: (N, 3).
    Returns:
        positions (N, 2), meaningless where the depth (N,) along the optical axis is not positive.
    """
    camera = footage.camera
    pixels, depth = camera.project(points)
    if footage.distortion is not None:
        lens = footage.distortion
        before = depth > 1e-6
        flat = np.where(before[:, None], _normalized(pixels, camera), 0.0)
        pixels = _in_pixels(distorted(lens.model, lens.coefficients, flat), camera)
    return pixels, depth


def write_st_maps(footage: Footage, camera: Camera, folder: Path) -> None:
    """Write the lens of a footage as two ST maps, OpenEXR files with 32-bit channels R and G, as compositors read them.

    A pixel of an ST map tells where to read: R across, G up from the lower edge, both from 0 to 1.

    ``undistort.exr``: to make the pinhole picture of the footage's size; ``redistort.exr``: to bring it back into the lens.

    Args:
        camera: of the working picture.
    """
    wide = camera.resized(footage.camera.width, footage.camera.height)
    size = np.array([wide.width, wide.height])
    lens = footage.distortion
    flat = _normalized(_centres(wide), wide)
    there = flat if lens is None else distorted(lens.model, lens.coefficients, flat)
    read = _in_pixels(there, footage.camera).reshape(wide.height, wide.width, 2)
    _write_st(folder / "undistort.exr", (read / size).astype(np.float32))
    _write_st(folder / "redistort.exr", (work_positions(footage, wide) / size).astype(np.float32))


def _write_st(path: Path, shares: Float32) -> None:
    """One ST map of shares (H, W, 2) of width and height, counted from the upper left corner."""
    import OpenEXR  # only a drive with a lens needs it

    up = np.ascontiguousarray(1.0 - shares[..., 1])
    across = np.ascontiguousarray(shares[..., 0])
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"R": across, "G": up, "B": np.zeros_like(up)}) as file:
        file.write(str(path))  # a stage's outputs appear whole or not at all: it opens the file itself, by name
