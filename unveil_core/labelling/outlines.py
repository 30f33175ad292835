"""Outlines of objects on the photograph: colour decides where geometry leaves it open."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import disc, grab_cut
from unveil_core.labelling.silhouettes import Silhouette

__all__ = ["cut", "joined", "outlined"]

ITERATIONS = 2
"""Rounds of learning colours and cutting; four of them changed 0.03 % of a street's pixels."""
BEFORE_M = 0.4
"""What stands nearer than an object by more than this, metres, hides it."""
LEAST_BEFORE_PX = 20
"""Fewer pixels before an object are specks."""
LONGEST_PX = 200
"""Windows longer than this, pixels, are cut at half their size or less; the border follows the image to a pixel all the same."""


def outlined(image: NDArray[np.uint8], found: Sequence[Silhouette], upright: Float32) -> NDArray[np.uint16]:
    """(H, W) id of the object that each pixel shows, 0 = none.

    Args:
        image: (H, W, 3) uint8; found: its objects, near ones first.
        upright: (H, W) depth of points of what stays and may stand before objects, metres; inf where there are none.
    """
    owner = np.zeros(image.shape[:2], dtype=np.uint16)
    for silhouette in found:
        window = silhouette.window
        hidden = owner[window] > 0
        static = upright[window] < silhouette.depth - BEFORE_M
        # Points on a pole lie in rows: what is between them belongs to it.
        static = cv2.morphologyEx(static.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 3), np.uint8)).astype(bool)
        static = _large(static, LEAST_BEFORE_PX)
        own = _own(image[window], silhouette, hidden, static)
        owner[window][own & ~hidden] = silhouette.box.id
    return owner


def _own(image: NDArray[np.uint8], it: Silhouette, hidden: Mask, static: Mask) -> Mask:
    """Pixels of a window that show an object."""
    if it.tiny:
        return it.possible & ~static
    sure, likely = it.sure & ~static & ~hidden, it.likely & ~static & ~hidden
    possible = it.possible & ~static & ~hidden
    outside = ~it.possible & ~hidden
    if likely.sum() < 20 or outside.sum() < 20:
        return likely
    state = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    state[possible] = cv2.GC_PR_BGD
    state[likely] = cv2.GC_PR_FGD
    state[sure] = cv2.GC_FGD
    picture = image.copy()
    if hidden.any():
        # What nearer objects cover says nothing: it gets colours from outside, so that it teaches the model none.
        where = np.flatnonzero(hidden.ravel())
        colors = image[outside]
        picture.reshape(-1, 3)[where] = colors[(where * 7919) % len(colors)]
    own = cut(picture, state)
    own = cv2.morphologyEx((own | sure).astype(np.uint8), cv2.MORPH_CLOSE, disc(2)).astype(bool) & possible
    # A pixel too many is invented, one too few stays as a ghost.
    return cv2.dilate(joined(own | sure, sure).astype(np.uint8), disc(1)).astype(bool) & ~static


def cut(image: NDArray[np.uint8], state: NDArray[np.uint8]) -> Mask:
    """GrabCut, on a smaller copy of large windows."""
    height, width = state.shape
    shrink = max(1, -(-max(height, width) // LONGEST_PX))
    small, state_small = image, state.copy()
    if shrink > 1:
        size = (max(width // shrink, 1), max(height // shrink, 1))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        state_small = cv2.resize(state, size, interpolation=cv2.INTER_NEAREST)
    if not ((state_small & 1).any() and (~state_small & 1).any()):
        return (state & 1).astype(bool)
    grab_cut(small[..., ::-1], state_small, ITERATIONS)
    own = (state_small & 1).astype(np.uint8)
    if shrink > 1:
        soft = cv2.resize(own.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        guide = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        soft = cv2.ximgproc.guidedFilter(guide, soft, 2 * shrink, 30.0)
        return soft > 0.5
    return own.astype(bool)


def _large(mask: Mask, least: int) -> Mask:
    """The parts of a mask that have so many pixels."""
    _, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= least
    large[0] = False
    return large[label]


def joined(own: Mask, sure: Mask) -> Mask:
    """Without crumbs that hold nothing sure, and without holes."""
    count, label = cv2.connectedComponents(own.astype(np.uint8), connectivity=4)
    keep = np.zeros(count, dtype=bool)
    keep[np.unique(label[sure])] = True
    keep[0] = False
    own = keep[label]
    count, label, stats, _ = cv2.connectedComponentsWithStats((~own).astype(np.uint8), connectivity=4)
    hole = stats[:, cv2.CC_STAT_AREA] < 0.02 * own.sum()
    hole[0] = False
    return own | hole[label]
