"""The outline of an object in one photograph: its points say where, colours decide between them (GrabCut)."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.geometry.images import disc, within
from unveil_core.labelling.outlines import cut, joined
from unveil_core.marking.asked.prompts import Prompt
from unveil_core.marking.seeds import Seeds

__all__ = ["Outliner", "object_outline"]

CLICK_PX = 0.008
"""Radius of a click, a share of the picture's width."""
TINY_PX = 12
"""Objects smaller than this, pixels, are taken by their points alone: no colours can be learned from so few."""
LEAST_SHARE = 0.5
"""Of what geometry expects: where colours find less, they are those of the shade that the object stands in."""
NEAR, FAR = 0.05, 0.12
NEAR_APART, FAR_APART = 0.4, 0.7
"""Without points, what lies so near to the clicks is probably theirs, and what lies no farther may be: shares of the picture's
width, and of what the clicks are apart; the larger of both counts."""

Outliner = Callable[[int, Seeds | None, Prompt | None], Mask]
"""Gives the pixels (H, W) of an object in a frame: its index, what geometry says, and what a person says, of it there."""


def object_outline(image: NDArray[np.uint8], seeds: Seeds | None, prompt: Prompt | None = None) -> Mask:
    """(H, W) pixels of an object in a photograph (H, W, 3), by geometry and by what a person says."""
    shape = image.shape[:2]
    if prompt is not None and prompt.matte is not None:
        return prompt.matte.copy()
    radius = CLICK_PX * shape[1]
    own = np.zeros(shape, dtype=bool) if prompt is None else prompt.own(shape, radius)
    others = np.zeros(shape, dtype=bool) if prompt is None else prompt.others(shape, radius)
    found = np.zeros(shape, dtype=bool)
    if seeds is None:
        return found if not own.any() else _by_colour_alone(image, own & ~others, others)
    found[seeds.window] = _within_window(image[seeds.window], seeds, own[seeds.window], others[seeds.window])
    return found | (own & ~others)


def _within_window(image: NDArray[np.uint8], it: Seeds, own: Mask, others: Mask) -> Mask:
    allowed = (it.possible | own) & ~others & ~(it.hidden & ~own)
    if it.size < TINY_PX:
        return (it.likely | own) & allowed
    sure = (it.sure | own) & ~others
    state = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    state[it.possible] = cv2.GC_PR_BGD
    state[it.likely] = cv2.GC_PR_FGD
    state[it.other | it.hidden] = cv2.GC_BGD
    state[sure] = cv2.GC_FGD
    state[others] = cv2.GC_BGD
    expected = it.likely & allowed
    mask = (cut(image, state) & allowed) | sure
    if mask.sum() < LEAST_SHARE * expected.sum():
        mask = expected | sure
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc(1)).astype(bool) & allowed
    return joined(closed | sure, sure)


def _by_colour_alone(image: NDArray[np.uint8], own: Mask, others: Mask) -> Mask:
    """An object that no point lies on: what looks like the clicked pixels and hangs together with them."""
    rows, columns = np.nonzero(own)
    if not len(rows):
        return own
    apart = float(max(np.ptp(columns), np.ptp(rows)))
    near, far = (max(a * own.shape[1], b * apart) for a, b in ((NEAR, NEAR_APART), (FAR, FAR_APART)))
    reach = int(2 * far)
    window = (
        slice(max(int(rows.min()) - reach, 0), int(rows.max()) + reach + 1),
        slice(max(int(columns.min()) - reach, 0), int(columns.max()) + reach + 1),
    )
    state = np.full(own.shape, cv2.GC_BGD, np.uint8)[window]
    state[within(own, far)[window]] = cv2.GC_PR_BGD
    state[within(own, near)[window]] = cv2.GC_PR_FGD
    state[others[window]] = cv2.GC_BGD
    state[own[window]] = cv2.GC_FGD
    found = own.copy()
    if (state == cv2.GC_BGD).any():
        found[window] = joined((cut(image[window], state) & ~others[window]) | own[window], own[window])
    return found
