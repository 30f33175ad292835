"""Labels and colours for points: a visibility-checked vote over the views.

*3D StreetUnveiler*, section 3.1, gives each surfel one hard label; here it is the label that most views, weighted by
nearness, show where the point is really seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Levels
from unveil_core.semantics.visibility import PointsInView

__all__ = ["label_share", "sample_colors", "view_weights", "vote_labels"]


BORDER_PX, LEAST_SHARE = 2, 0.3
"""A pixel counts in full where this share of the square of so wide a border around it has its own label."""


def label_share(image: NDArray[np.integer], rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
    """How much of the square of ``2 * BORDER_PX + 1`` pixels around each of some pixels (M,) has its own label, 0 to 1.

    Args:
        image: (H, W) labels; rows, columns: (M,) of the pixels.
    """
    padded = np.pad(image, BORDER_PX, mode="edge")
    label = image[rows, columns]
    same = np.zeros(len(rows))
    for i in range(2 * BORDER_PX + 1):
        for j in range(2 * BORDER_PX + 1):
            same += padded[rows + i, columns + j] == label
    return same / (2 * BORDER_PX + 1) ** 2


def view_weights(image: NDArray[np.integer], seen: PointsInView) -> NDArray[np.float64]:
    """(M,) what the votes of a view count: nearer ones more, those of lonely pixels of its labels (H, W) less."""
    share = label_share(image, seen.rows, seen.columns)
    weight: NDArray[np.float64] = np.minimum(share / LEAST_SHARE, 1.0) / seen.depth
    return weight


def vote_labels(
    count: int, views: Sequence[PointsInView], label_image: Callable[[int], NDArray[np.int64]], label_count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Label points by the views that see them, nearer views counting more and lonely pixels, as noise leaves them, less.

    Pixels at borders count in full: all of a thin pole are, and the wall behind it would take its points.

    Args:
        count: P; views: which of the points each of V views sees.
        label_image: gives (H, W) compact labels of view v, negative = no vote.
        label_count: K.
    Returns:
        labels (P,), -1 where nobody voted; the share of the winning label among all votes (P,).
    """
    votes = np.zeros((count, label_count))
    for v, seen in enumerate(views):
        image = label_image(v)
        label = image[seen.rows, seen.columns]
        weight = view_weights(image, seen)
        counts = label >= 0
        votes[seen.index[counts], label[counts]] += weight[counts]
    total = votes.sum(axis=1)
    labels = np.where(total > 0, votes.argmax(axis=1), -1)
    return labels, votes.max(axis=1) / np.maximum(total, 1e-12)


def sample_colors(
    count: int, views: Sequence[PointsInView], image: Callable[[int], Levels]
) -> tuple[Float32, NDArray[np.bool_]]:
    """Colour points from the views that see them, nearer views counting more.

    Args:
        count: P; views: which of the points each of V views sees.
        image: gives (H, W, 3) of view v, levels of 255.
    Returns:
        colours (P, 3), likewise, and which points (P,) any view saw.
    """
    total = np.zeros((count, 3))
    weight = np.zeros(count)
    for v, seen in enumerate(views):
        w = 1.0 / seen.depth**2
        total[seen.index] += image(v)[seen.rows, seen.columns] * w[:, None]
        weight[seen.index] += w
    known = weight > 0
    mean = np.where(known[:, None], total / np.maximum(weight, 1e-300)[:, None], 128.0)
    return mean.astype(np.float32), known
