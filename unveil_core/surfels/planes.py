"""How well photographs agree if what they show lies in a plane.

A plane sweep along the directions in which a street's surfaces lie (Gallup et al., *Real-time plane-sweeping stereo with multiple
sweeping directions*, CVPR 2007), for which only the agreement is asked. A car sees the ground ahead of it three times as large from
the next frame: the finer picture is blurred to what the coarser one can show, or nothing would correlate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float32, Float64, Levels
from unveil_core.geometry.camera import Camera
from unveil_core.surfels.pictures import from_array, reduced_gray, to_other
from unveil_core.surfels.plane_kernels import BAND, compare_bands

__all__ = ["BlurredView", "agreement", "blurred_view"]

SCALES = (1.5, 2.2, 3.2, 4.5, 6.5)
"""Pixels of one picture to one of the other for which levels are made; each serves up to halfway to the next."""
STEPS = np.array([((a + b) / 2) ** 2 for a, b in zip((1.0, *SCALES[:-1]), SCALES, strict=True)])
"""Areas of one picture's pixel in the other from which on each is taken."""
BLUR = 0.5
"""Standard deviation of the blur, as a share of the scale. A pixel's own is 0.3, and poses are right to a pixel or so. Photographs
of real cobbles agree on the ground to 0.51 without a blur, 0.64 with 0.3 and 0.70 with 0.5, of a drawn street
to 0.90, 0.93 and 0.94."""


@dataclass(frozen=True, eq=False)
class BlurredView:
    """A photograph to be compared with others: camera, and the grey picture ever coarser, (L, H, W), all of one size."""

    camera: Camera
    levels: Float32


def blurred_view(camera: Camera, image: Levels, side: int) -> BlurredView:
    """A photograph (H, W, 3) with its longer side reduced to ``side`` pixels."""
    small, gray = reduced_gray(camera, image, side)
    levels = [gray, *(cv2.GaussianBlur(gray, (0, 0), BLUR * scale) for scale in SCALES)]
    return BlurredView(small, np.stack(levels))


def agreement(
    own: BlurredView, others: Sequence[BlurredView], normal: Float64, distances: Float64, half: int
) -> Float32:
    """(H, W) the best correlation with any of the others if a pixel lies in any of some parallel planes, -1 where nothing can be
    compared. A plane carries one picture over to another by a homography (Hartley and Zisserman, *Multiple view geometry*, result
    13.1).

    Args:
        others: of one size. normal: (3,) unit, in the world, away from the camera; distances: (D,) of the planes from it.
        half: of the side of the window that is compared.
    """
    ways = [to_other(own.camera, other.camera) for other in others]
    # Of a plane the inverse depth is linear in the array position.
    inverse = own.camera.world_to_camera[:3, :3] @ normal @ from_array(own.camera)
    turns = np.stack([[turn + np.outer(shift, inverse) / d for turn, shift in ways] for d in distances])
    result = np.empty(own.levels.shape[1:], np.float32)
    pictures = np.stack([other.levels for other in others])
    bands = -(-len(result) // BAND)
    in_parallel(compare_bands, bands, 1, own.levels, pictures, turns, STEPS, half, result)
    return result
