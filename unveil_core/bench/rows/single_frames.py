"""Rows without 3D and without time: each frame filled for itself, the whole object masked."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from unveil_core.base.progress import Progress
from unveil_core.base.types import Mask, Picture
from unveil_core.bench.rows.footage import Footage, deliver, fill_around
from unveil_core.evaluate.baselines import shift_map, telea
from unveil_core.geometry.images import border_px

__all__ = ["classic", "per_frame", "untouched"]


def untouched(footage: Footage, progress: Progress) -> list[Picture]:
    """The crowded frames themselves."""
    return list(footage.photographs)


def per_frame(footage: Footage, progress: Progress) -> list[Picture]:
    """The configured single-image model on each frame (the row of LaMa and SDXL)."""
    clean = []
    for image, hole in zip(footage.photographs, footage.holes, strict=True):
        clean.append(fill_around(footage.single_image, image, hole))
        progress(len(clean), len(footage.photographs), "filling frame by frame")
    return deliver(footage, None, clean)


def classic(fill: Callable[[Picture, Mask], Picture], *, wide: bool) -> Callable[[Footage, Progress], list[Picture]]:
    """A row of one of ``evaluate.baselines``, which grow masks a little themselves.

    Args:
        wide: whether it fills the wider holes, as the others do.
    """

    def run(footage: Footage, progress: Progress) -> list[Picture]:
        clean: list[Picture] = []
        for image, hole in zip(footage.photographs, footage.holes if wide else footage.removed, strict=True):
            size = 2 * border_px(hole.shape[1]) + 1
            kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            eroded = cv2.erode(hole.astype(np.uint8), kernel).astype(bool)
            clean.append(fill(image, eroded))
            progress(len(clean), len(footage.photographs), "filling frame by frame")
        return deliver(footage, None, clean)

    return run


TELEA = classic(telea, wide=True)
SHIFT_MAP = classic(shift_map, wide=False)
"""Wider holes gain Telea 1.8 dB on the sample street and cost the shift-map 0.6."""
