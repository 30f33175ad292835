"""The shadow of a dynamic object in one frame: ground beside it that is dark here and lit in most other frames.

Static objects cast the same shadow in all frames, so ground that is darker than in other frames is in the shadow of a dynamic one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.contacts import FAR_M

__all__ = ["mover_shadow"]

DARK = 0.8
"""Shadow is darker than this share of the median brightness that other frames show there."""
REACH = 2.5
"""How far a shadow may reach beyond its object in the image, in heights of the object."""
OTHERS, FEWEST_OTHERS = 16, 3
"""How many other frames at most are compared at a place, and how many at least must show it."""
AROUND, FEWEST_AROUND = 400, 20
"""About so many places farther off, and at least the second, measure how much brighter or darker this photograph is than the
others."""
ALMOST_LIT, ALIKE = 0.9, 1.25
"""A shadow is extended over ground less bright than ``ALIKE`` times its median, unless other frames show that ground lit: a
brightness of at least ``ALMOST_LIT`` of theirs."""
EVIDENT = 0.5
"""Ground far from all movers that is darker than in other frames, up to which they have shadows, as a share of such ground beside
them: beyond, frames lie on one another badly, and nothing says that it is the movers that darken it. And the share of a shadow
that other frames must show lit."""
TOUCH_PX = 4
"""So far from a mover its shadow may begin, pixels at 384, see :func:`unveil_core.geometry.images.border_px`."""


def mover_shadow(
    frame: int,
    mask: Mask,
    cameras: Sequence[Camera],
    own: Sequence[int],
    foreign: Sequence[int],
    gray: Callable[[int], NDArray[np.float32]],
    plain: Callable[[int], Mask],
    ground: HeightField,
) -> Mask:
    """(H, W) pixels of a frame in the shadow of its dynamic objects.

    Args:
        frame: index; mask: (H, W) of its dynamic objects, all False where it has none.
        cameras: of all frames; own: the other frames of this camera, the nearest in time first; foreign: those of other cameras,
            likewise, whose colours are their own.
        gray: gives (H, W) brightness of frame v; plain: its ground pixels without dynamic objects.
    """
    camera = cameras[frame]
    none = np.zeros(mask.shape, dtype=bool)
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return none
    count, component, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    region = np.zeros(mask.shape, np.uint8)
    for k in range(1, count):
        x, y, w, h = stats[k, :4]
        reach = int(REACH * h) + 2
        # Beside what casts it, and before it: behind it the thing itself hides the ground.
        region[y : y + h + h // 2 + 2, max(0, x - reach) : x + w + reach] = 1
    here = plain(frame)
    near = here & region.astype(bool) & ~mask
    far = np.flatnonzero(here & ~region.astype(bool))
    far = far[:: max(1, len(far) // AROUND)]
    asked = np.concatenate([np.flatnonzero(near), far])
    if not near.any():
        return none
    row, column = np.unravel_index(asked, mask.shape)
    rays = camera.rays_at(np.stack([column + 0.5, row + 0.5], axis=1))
    depth = ground.first_met(camera.centre, rays, near=NEAR_M, far=FAR_M)
    known = np.isfinite(depth)
    places = camera.centre + np.where(known, depth, 0.0)[:, None] * rays
    order = [*_near_and_far(own), *_near_and_far(foreign)]
    here_gray = gray(frame)[row, column]
    shown = np.full((len(order), len(asked)), np.nan, np.float32)
    for k, v in enumerate(order):
        other = cameras[v]
        pixel, away = other.project(places)
        ok = known & other.in_picture(pixel, away, nearest=0.0) & (away < 3 * depth)
        index = np.flatnonzero(ok)
        r, c = pixel[index, 1].astype(int), pixel[index, 0].astype(int)
        free = plain(v)[r, c]
        shown[k, index[free]] = gray(v)[r[free], c[free]]
        if v in foreign:
            shown[k] *= _brighter(here_gray[near.sum() :], shown[k, near.sum() :])
    enough = np.isfinite(shown).sum(axis=0) >= FEWEST_OTHERS
    typical = np.ones(len(asked), np.float32)
    typical[enough] = np.nanmedian(shown[:, enough], axis=0)
    ratio = np.where(enough, here_gray / np.maximum(typical, 1.0), np.nan)
    beside = ratio[near.sum() :]
    exposure = float(np.nanmedian(beside)) if np.isfinite(beside).sum() >= FEWEST_AROUND else 1.0
    darker = ratio < DARK * exposure
    found, false = (
        darker[p].sum() / max(1, np.isfinite(ratio[p]).sum()) for p in (np.s_[: near.sum()], np.s_[near.sum() :])
    )
    if false > EVIDENT * found:
        return none
    dark = none.copy()
    dark[row[: near.sum()], column[: near.sum()]] = darker[: near.sum()]
    dark = cv2.morphologyEx(dark.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)).astype(bool)
    seed = cv2.dilate(
        mask.astype(np.uint8), np.ones((2 * border_px(camera.width, TOUCH_PX) + 1,) * 2, np.uint8)
    ).astype(bool)
    count, component = cv2.connectedComponents((dark | mask).astype(np.uint8), connectivity=8)
    touching = np.zeros(count, dtype=bool)
    touching[np.unique(component[seed & (dark | mask)])] = True
    touching[0] = False
    shadow = _whole(touching[component] & dark, near, (row, column), ratio / exposure, gray(frame))
    grown = cv2.dilate(shadow.astype(np.uint8), np.ones((2 * border_px(camera.width) + 1,) * 2, np.uint8)).astype(bool)
    return grown & (here | seed) & ~mask


def _near_and_far(frames: Sequence[int]) -> Sequence[int]:
    """Some of many frames: near ones show a place best, in far ones what moves has gone."""
    return frames[:: max(1, len(frames) // OTHERS)][:OTHERS]


def _brighter(here: NDArray[np.floating], there: NDArray[np.floating]) -> float:
    """How much brighter places are here than in the frame of another camera, NaN where it shows too few of them, as NaN says."""
    both = np.isfinite(there) & (there > 1)
    return float(np.median(here[both] / there[both])) if both.sum() >= FEWEST_AROUND else np.nan


def _whole(
    shadow: Mask,
    near: Mask,
    asked: tuple[NDArray[np.int64], NDArray[np.int64]],
    ratio: NDArray[np.floating],
    gray: NDArray[np.float32],
) -> Mask:
    """A shadow (H, W), extended over adjacent ground that is as dark and that too few other frames show, unless that is most of it:
    dark asphalt and lawns go on and on.

    Args:
        near: (H, W) ground to consider; asked: rows and columns (N,) of the pixels whose ``ratio`` (N,) is known, or nan.
        gray: (H, W) brightness.
    """
    if not shadow.any():
        return shadow
    lit = np.zeros(shadow.shape, dtype=bool)
    lit[asked] = ratio >= ALMOST_LIT
    alike = near & ~lit & (gray < ALIKE * np.median(gray[shadow]))
    _, component = cv2.connectedComponents((alike | shadow).astype(np.uint8), connectivity=8)
    evident, size = (np.bincount(component[m], minlength=component.max() + 1) for m in (shadow, alike | shadow))
    return shadow | ((evident > EVIDENT * size)[component] & alike)
