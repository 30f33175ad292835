"""Propagation by a reference network: a hole is inpainted with the frame that shows the place best as the reference.

As in *3D StreetUnveiler* (ICLR 2025, section 3.3), which uses LeftRefill (Cao et al., CVPR 2024).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow

__all__ = ["ReferenceFrame", "ReferenceInpainter", "ReferencePropagator"]

TOLERANCE = 0.1
"""Relative difference of depth within which two frames show the same place. Chosen on the two sample streets."""
LEAST_SHARE = 0.5
"""Share of a hole that a frame must show to be its reference."""
SHARPEST = 2.0
"""Ratio of resolutions from which on a finer reference is no better: the network works at the hole's resolution."""
LEAST_MARGIN_PX = 32
"""Least width of the surroundings that the network is given around a hole, pixels."""
SAMPLES = 2000
"""Pixels of a hole that are looked up in another frame: its share is known to a per cent."""
SCALE_LIMITS = (0.25, 4.0)
"""Limits of the ratio by which a place may appear larger in the reference."""


class ReferenceInpainter(Protocol):
    """Fill ``mask`` (H, W) of ``image`` (H, W, 3) RGB, levels of 255, with what ``reference`` (H', W', 3) shows of the same place;
    pixels outside the mask come back unchanged."""

    def __call__(self, image: Levels, mask: Mask, reference: Levels) -> Levels: ...


@dataclass(frozen=True, eq=False)
class ReferenceFrame:
    """A cleaned frame: its camera, image (H, W, 3), levels of 255, and depth (H, W) along the optical axis, holes included."""

    camera: Camera
    image: Levels
    depth: NDArray[np.float32]


class ReferencePropagator:
    """A network with a reference, and the cleaned frames that it may be given as one."""

    def __init__(self, inpaint: ReferenceInpainter) -> None:
        self._inpaint = inpaint
        self._frames: list[ReferenceFrame] = []

    def add(self, camera: Camera, image: Levels, depth: NDArray[np.floating]) -> None:
        """Add a frame that has invented something; see :class:`ReferenceFrame`."""
        self._frames.append(ReferenceFrame(camera, image, depth.astype(np.float32)))

    def paint(self, camera: Camera, image: Levels, hole: Mask, depth: NDArray[np.floating]) -> tuple[Levels, Mask]:
        """Paint each hole by the frame that shows it best; holes that none shows stay as they are.

        Args:
            camera: of the frame; image: (H, W, 3), levels of 255.
            hole: (H, W) what no photograph shows; depth: (H, W) along the optical axis, holes included.
        Returns:
            the image, and (H, W) bool, what was painted.
        """
        result, painted = image.copy(), np.zeros_like(hole)
        count, component, boxes, _ = cv2.connectedComponentsWithStats(grow(hole, 3).astype(np.uint8), connectivity=8)
        for k in range(1, count):
            part_of_hole = hole & (component == k)
            best = _best(self._frames, camera, part_of_hole, depth)
            if best is None:
                continue
            frame, pixels, places = best
            x, y, w, h = (int(v) for v in boxes[k, :4])
            margin = max(LEAST_MARGIN_PX, (w + h) // 3)
            part = (
                slice(max(0, y - margin), min(image.shape[0], y + h + margin)),
                slice(max(0, x - margin), min(image.shape[1], x + w + margin)),
            )
            filled = self._inpaint(
                np.ascontiguousarray(result[part]),
                np.ascontiguousarray(part_of_hole[part]),
                _around(frame, pixels, part, places),
            )
            result[part] = np.where(part_of_hole[part][..., None], filled, result[part])
            painted |= part_of_hole
        return result, painted


def _best(
    frames: list[ReferenceFrame], camera: Camera, hole: Mask, depth: NDArray[np.floating]
) -> tuple[ReferenceFrame, NDArray[np.float64], NDArray[np.int64]] | None:
    """The frame that shows most of a hole, counted by how finely, where it shows sampled pixels of it, (N, 2) as x and y, and
    these pixels, (N, 2) as row and column."""
    rows, columns = np.nonzero(hole)
    step = max(1, len(rows) // SAMPLES)
    rows, columns = rows[::step], columns[::step]
    z = depth[rows, columns].astype(np.float64)
    points = camera.centre + z[:, None] * camera.rays()[rows, columns]
    best, most = None, 0.0
    for frame in frames:
        other = frame.camera
        pixels, distance = other.project(points)
        shown = other.in_picture(pixels, distance)
        c, r = (np.where(shown, pixels[:, i], 0).astype(np.int64) for i in (0, 1))
        shown &= np.abs(frame.depth[r, c] - distance) < TOLERANCE * distance
        if shown.mean() < LEAST_SHARE:
            continue
        finer = (other.fx / distance[shown]) / (camera.fx / np.maximum(z[shown], 1e-6))
        score = float(np.minimum(finer, SHARPEST).sum())
        if score > most:
            best, most = (frame, pixels[shown], np.stack([rows, columns], axis=1)[shown]), score
    return best


def _around(
    frame: ReferenceFrame, pixels: NDArray[np.float64], part: tuple[slice, slice], places: NDArray[np.int64]
) -> Levels:
    """The part of a frame that shows what a part of another shows: the same place where it lies there, as much around it.

    Args:
        pixels: (N, 2) x and y in the frame of what lies at ``places``, (N, 2) rows and columns of the other.
    """
    height, width = part[0].stop - part[0].start, part[1].stop - part[1].start
    rows, columns = places[:, 0] + 0.5, places[:, 1] + 0.5
    # How much larger the place appears in the reference, by its spread; a few pixels have none.
    spread = np.hypot(rows.std(), columns.std())
    ratio = np.hypot(*pixels.std(axis=0)) / spread if spread > 1 and len(pixels) > 8 else 1.0
    ratio = float(np.clip(ratio, *SCALE_LIMITS))
    # The hole need not lie in the middle of its part: at the image's border it does not.
    centre_row, centre_column = rows.mean() - part[0].start, columns.mean() - part[1].start
    column, row = pixels.mean(axis=0)
    spans = []
    for at, before, length, total in (
        (row, centre_row, height, frame.image.shape[0]),
        (column, centre_column, width, frame.image.shape[1]),
    ):
        # Mirrored beyond the border: moved inwards, the place would lie elsewhere than in the image.
        place = (round(at - before * ratio) + np.arange(max(1, round(length * ratio)))) % (2 * total)
        spans.append(np.minimum(place, 2 * total - 1 - place))
    return np.ascontiguousarray(frame.image[np.ix_(*spans)])
