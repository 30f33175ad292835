"""Rows that go back in time with the frame after each as the reference, the whole object masked: no ideal mask, no street
chart, no surfels for what was invented."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress
from unveil_core.base.types import Mask, Picture
from unveil_core.bench.rows.footage import SOLID, Footage, Splats, deliver, fill_around, open_splats
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import tracks
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.depth import complete_depth
from unveil_core.raster.picture import render_numpy

__all__ = ["reference_reverse", "transfer_reverse", "transferred"]

TOLERANCE = 0.1
"""Relative difference of depth within which two frames show the same place."""


def reference_reverse(footage: Footage, progress: Progress) -> list[Picture]:
    """Cao et al., *LeftRefill* (CVPR 2024), as *3D StreetUnveiler* compares with it: a network paints each frame's whole mask
    with the frame after it, already painted, as the reference. The last frame is the single-image model's."""
    assert footage.reference is not None, "the harness runs this row only with a network"
    clean = list(footage.photographs)
    done = 0
    for track in tracks(footage.drive):
        later: Picture | None = None
        for i in reversed(track):
            image, hole = footage.photographs[i], footage.holes[i]
            if hole.any():
                if later is None:
                    clean[i] = fill_around(footage.single_image, image, hole)
                else:
                    painted = footage.reference(image, hole, later)
                    clean[i] = np.where(hole[..., None], painted, image).astype(np.uint8)
            later = clean[i]
            done += 1
            progress(done, len(clean), "painting, last frame first")
    return deliver(footage, None, clean)


def transfer_reverse(footage: Footage, progress: Progress) -> list[Picture]:
    """The same without a network, a stand-in of our own: the reference's pixels are carried over by the scene's depth, and
    what it does not show is the single-image model's."""
    splats = open_splats(footage)
    clean = list(splats.images)
    done = 0
    for track in tracks(footage.drive):
        later: tuple[Camera, Picture, NDArray[np.float64]] | None = None
        for i in reversed(track):
            camera, hole = footage.drive.frames[i].camera, footage.holes[i]
            depth = _empty_depth(splats, camera, hole)
            rest, picture = hole, clean[i]
            if later is not None and hole.any():
                moved, shown = transferred(camera, depth, hole, *later)
                picture = np.where(shown[..., None], moved, picture).astype(np.uint8)
                rest = hole & ~shown
            if rest.any():
                picture = fill_around(footage.single_image, picture, rest)
            clean[i] = picture
            later = (camera, picture, depth)
            done += 1
            progress(done, len(clean), "carrying over, last frame first")
    return deliver(footage, splats, clean)


def _empty_depth(splats: Splats, camera: Camera, hole: Mask) -> NDArray[np.float64]:
    """(H, W) depth without the removed objects: rendered where something stands behind them, else continued from around;
    of the sky, far away."""
    out = render_numpy(splats.remaining, camera, near=NEAR_M, far=FAR_M)
    solid = out["alpha"] > SOLID
    depth = np.where(solid, out["depth"], FAR_M).astype(np.float32)
    return complete_depth(depth, solid, hole & ~solid, np.full(hole.shape, np.inf))


def transferred(
    camera: Camera,
    depth: NDArray[np.float64],
    wanted: Mask,
    other: Camera,
    picture: Picture,
    other_depth: NDArray[np.float64],
) -> tuple[Picture, Mask]:
    """What another view shows of a view's pixels.

    Args:
        camera: of the view; depth: (H, W) in it; wanted: (H, W) its pixels that are asked for.
        other: camera of the other view, with its picture (H', W', 3) and depth (H', W').
    Returns:
        (H, W, 3) uint8 the other's colours, and (H, W) where it shows the same place.
    """
    rows, columns = np.nonzero(wanted)
    points = camera.centre + depth[rows, columns, None] * camera.rays()[rows, columns]
    pixels, distance = other.project(points)
    ok = other.in_picture(pixels, distance)
    c, r = (np.where(ok, pixels[:, i], 0).astype(np.int64) for i in (0, 1))
    ok &= np.abs(other_depth[r, c] - distance) < TOLERANCE * distance
    shown = np.zeros_like(wanted)
    shown[rows[ok], columns[ok]] = True
    place = np.full((*wanted.shape, 2), -1.0, np.float32)
    # remap counts from the first pixel's centre. Cubic: a pixel may be carried many times, and bilinear would blur it away.
    place[rows[ok], columns[ok]] = pixels[ok] - 0.5
    moved = cv2.remap(picture, place[..., 0], place[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return moved.astype(np.uint8), shown
