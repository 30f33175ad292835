"""What speaks against a pixel of the empty street: a few numbers, each 0 or more, each the more the less sure."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Levels, Mask
from unveil_core.geometry.images import smoothed
from unveil_core.provenance.leftovers import Leftovers
from unveil_core.provenance.witnesses import Seen

__all__ = ["DOUBTS", "UNIT_LEVELS", "UNIT_SHARE", "find_doubts"]

DOUBTS = {
    "inside": "log2 of 1 plus the distance from the nearest pixel that stays as it is, pixels at 384 px",
    "distance": "log2 of 1 plus the distance of the surface from the camera, metres",
    "contrast": "standard deviation of the colours around",
    "beside": "difference from the nearest pixel that stays as it is",
    "refitted": "difference between the optimized scene and the inpainted frame",
    "changed": "difference from the photograph; relit pixels only",
    "unseen": "1 over 1 plus the number of frames that show the place",
    "contradicted": "difference from what these frames show; 0 without any",
    "disagreed": "how much they differ from one another",
    "darker": "share by which ground is darker than the seen ground around, in units of ``UNIT_SHARE``",
    "near": "exp(-distance) from the nearest removed object, metres",
}
"""The numbers in their order, and what each is. Differences and deviations are root mean squares of the channels of smoothed
colours, in units of ``UNIT_LEVELS``."""
UNIT_LEVELS = 12.0
"""Unit of differences, levels of 255: that of the definition of a right pixel, see ``certainty``."""
UNIT_SHARE = 0.25
"""Unit of darkness: a fifth to a third of a street's luma is what makes it wrong, and the weights of the fit are of one size."""
MOST = 1.5
"""Differences count up to so many units: what is beyond being wrong makes hardly less sure. Of 1, 1.5, 2 and 4 the one that ranks
the pixels of each sample street best by a fit to the other."""
AROUND_PX = 9
"""Side of the window in which contrast is measured, pixels."""
SKY_M = 100.0
"""Distance at which the sky counts, metres: as far as a scene is rendered."""


def find_doubts(
    delivered: Levels,
    photograph: Levels,
    made: tuple[Levels, Levels],
    changed: Mask,
    relit: Mask,
    depth: Float32,
    seen: Seen,
    left: Leftovers,
) -> Float32:
    """(P, D) of the changed pixels, in the order of :data:`DOUBTS`.

    Args:
        delivered, photograph: (H, W, 3) the clean frame and what it was made of, in canonical colours.
        made: (H, W, 3) each, the optimized scene and the inpainted frame, likewise.
        changed: (H, W) of P pixels that do not show the photograph; relit: (H, W) of them those that show it relit.
        depth: (H, W) of the empty scene, metres, 0 for the sky; seen, left: of the P pixels.
    """
    result = smoothed(delivered)
    away, nearest = _nearest_unchanged(changed)
    known = smoothed(photograph)
    rows, columns = np.nonzero(changed)
    here = result[rows, columns]
    beside = known[nearest[0][rows, columns], nearest[1][rows, columns]]
    surface = depth[rows, columns]
    columns_of = {
        "inside": np.log2(1 + away[rows, columns] * 384 / changed.shape[1]),
        "distance": np.log2(1 + np.where(surface > 0, np.minimum(surface, SKY_M), SKY_M)),
        "contrast": _units(_contrast(delivered)[rows, columns]),
        "beside": _units(_difference(here, beside)),
        "refitted": _units(_difference(smoothed(made[0])[rows, columns], smoothed(made[1])[rows, columns])),
        "changed": np.where(relit[rows, columns], _units(_difference(here, known[rows, columns])), 0),
        "unseen": 1 / (1 + seen.count),
        "contradicted": np.where(seen.count > 0, _units(_difference(here, seen.color)), 0),
        "disagreed": _units(seen.spread),
        "darker": left.darker / UNIT_SHARE,
        "near": left.near,
    }
    return np.stack([columns_of[name] for name in DOUBTS], axis=1).astype(np.float32)


def _difference(one: Float32, other: Float32) -> Float32:
    """(P,) root mean square of the channels of the difference of colours (P, 3)."""
    return np.sqrt(np.square(one - other).mean(axis=1)).astype(np.float32)


def _units(levels: Float32) -> Float32:
    return np.minimum(levels / UNIT_LEVELS, MOST).astype(np.float32)


def _contrast(picture: Levels) -> Float32:
    """(H, W) standard deviation of the colours around each pixel, levels."""
    plane = picture.astype(np.float32)
    mean, square = (cv2.blur(p, (AROUND_PX, AROUND_PX)) for p in (plane, plane * plane))
    deviation: Float32 = np.sqrt(np.maximum(square - mean * mean, 0).mean(axis=2)).astype(np.float32)
    return deviation


def _nearest_unchanged(changed: Mask) -> tuple[Float32, tuple[np.ndarray, np.ndarray]]:
    """(H, W) distance to the nearest pixel that is not changed, pixels, and its row and column; itself where all are."""
    if changed.all():
        rows, columns = np.indices(changed.shape)
        return np.full(changed.shape, float(max(changed.shape)), np.float32), (rows, columns)  # type: ignore[return-value]
    away, label = cv2.distanceTransformWithLabels(
        changed.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    rows, columns = np.nonzero(~changed)  # type: ignore[assignment]
    order = np.zeros(int(label.max()) + 1, dtype=np.int64)
    order[label[rows, columns]] = np.arange(len(rows))  # type: ignore[arg-type]
    return away, (rows[order[label]], columns[order[label]])  # type: ignore[index]
