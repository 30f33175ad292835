"""What the list of objects shows of each: the frames that see it, and a picture."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.drive import Drive

__all__ = ["frames_that_see", "thumbnail"]


def frames_that_see(
    drive: Drive, means: NDArray[np.float64], images: Sequence[NDArray[np.int64] | None], instance: int
) -> list[tuple[int, tuple[int, int, int, int]]]:
    """Frames that show an object with its rectangle (x0, y0, x1, y1), the one that shows it largest first."""
    found = []
    for v, frame in enumerate(drive.frames):
        camera = frame.camera
        image = images[v]
        if image is not None:
            rows, columns = np.nonzero(image == instance)
            whole = len(rows)
        else:
            pixels, depth = camera.project(means)
            ok = (depth > 0) & (pixels >= 0).all(axis=1)
            ok &= (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
            columns, rows = pixels[ok, 0].astype(int), pixels[ok, 1].astype(int)
            whole = int(ok.sum()) if ok.mean() > 0.3 else 0
        if whole < 12:
            continue
        rectangle = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
        inner = rectangle[0] > 1 and rectangle[2] < camera.width - 1 and rectangle[3] < camera.height - 1
        area = (rectangle[2] - rectangle[0]) * (rectangle[3] - rectangle[1])
        found.append((area * (2 if inner else 1), v, rectangle))
    found.sort(key=lambda f: (-f[0], f[1]))
    return [(v, rectangle) for _, v, rectangle in found]


def thumbnail(image: NDArray[np.uint8], rectangle: tuple[int, int, int, int], side: int = 96) -> NDArray[np.uint8]:
    """(side, side, 3) the square around a rectangle (x0, y0, x1, y1) of an image."""
    x0, y0, x1, y1 = rectangle
    half = max(x1 - x0, y1 - y0) * 0.6
    cx, cy = (x0 + x1) / 2, (y0 + y1) / 2
    matrix = np.array([[2 * half / side, 0, cx - half], [0, 2 * half / side, cy - half]])
    picture = cv2.warpAffine(
        image, matrix, (side, side), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )
    return picture.astype(np.uint8)
