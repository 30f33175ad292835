"""The corrections of a drive in each of its frames, at working size and at that of the footage."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.corrections.carry import positions_in, shown_in
from unveil_core.corrections.files import Correction, read_paint
from unveil_core.delivery.full_size import as_color, in_exposure, put_colors
from unveil_core.delivery.lens import picture_positions, work_positions
from unveil_core.delivery.views import EmptyDepth
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.drives.drive import Footage, Frame
from unveil_core.drives.exposure import IDENTITY, Exposure
from unveil_core.drives.selecting import numbers_of
from unveil_core.geometry.images import grow, resampled, sample_at

__all__ = ["Corrections", "corrected_frames"]

COVERED = 1 / 512
"""Opacity above which a pixel is corrected: less than half a level of 8 bits."""
Invent = Callable[[int, Mask], Float32]
"""A frame's clean picture (H, W, 3) in [0, 1] of working size, with a mask (H, W) of it invented anew."""


def corrected_frames(corrections: Sequence[Correction], frames: Sequence[Frame]) -> list[int]:
    """The index of the frame that each correction is of: by its name, or by the number in it.

    Raises:
        SettingsError: the drive has no such frame.
    """
    known: dict[tuple[str, str | int | None], int] = {}
    for i, (frame, number) in enumerate(zip(frames, numbers_of(frames), strict=True)):
        known.setdefault((frame.camera_name, number), i)
        known[frame.camera_name, frame.name] = i
    found = []
    for c in corrections:
        counted: str | int = int(c.frame) if re.fullmatch(r"[0-9]{1,15}", c.frame) else c.frame
        index = known.get((c.camera, c.frame), known.get((c.camera, counted)))
        if index is None:
            raise SettingsError(
                f"{c.image}: the drive has no frame {c.frame} of camera {c.camera}",
                mend="correct the names, or take the entry out",
            )
        found.append(index)
    return found


@dataclass(frozen=True, eq=False)
class _Paint:
    """One correction: colours and opacity (h, w, 4) of the frame's delivered picture, and of its working picture (H, W, 4)."""

    index: int
    whole: Float32
    work: Float32


class Corrections:
    """What was mended, carried to all frames: an earlier correction covers a later one, in its own frame each its own first.

    Args:
        corrections: in order.
        frames: of the drive; exposures: of all.
        views: the empty street in all.
        invent: invents a part of a frame anew.
        cache: room for what the frames show of it.
    Raises:
        DriveError: an image is damaged, or no picture of its frame.
        SettingsError: the drive has no such frame.
    """

    def __init__(
        self,
        corrections: Sequence[Correction],
        frames: Sequence[Frame],
        exposures: Sequence[Exposure],
        views: Sequence[EmptyDepth],
        invent: Invent,
        cache: FrameCache,
    ) -> None:
        self._frames, self._exposures, self._views = frames, exposures, views
        self._at_work = cache.frames(len(frames), self._carried)
        pairs = zip(corrections, corrected_frames(corrections, frames), strict=True)
        self._paints = [self._paint(c, i, invent) for c, i in pairs]

    def _paint(self, correction: Correction, index: int, invent: Invent) -> _Paint:
        frame = self._frames[index]
        whole = read_paint(correction, frame)
        work = _at_work(whole, frame)
        if correction.invent:
            mask = work[..., 3] > COVERED
            work = np.dstack([invent(index, mask), mask.astype(np.float32)])
            whole = _at_size(work, frame)
        return _Paint(index, whole, work)

    def at_work(self, i: int) -> tuple[Float32, Float32]:
        """Colours (H, W, 3) in [0, 1] of frame ``i``'s photograph, and how far they cover its working picture (H, W)."""
        return self._at_work[i]

    def _carried(self, i: int) -> tuple[Float32, Float32]:
        frame = self._frames[i]
        size = (frame.camera.height, frame.camera.width)
        color, cover = np.zeros((*size, 3), np.float32), np.zeros(size, np.float32)
        for paint in self._in_order(i):
            if paint.index == i:
                new, over = paint.work[..., :3], paint.work[..., 3]
            else:
                at = self._positions(i, paint)
                if at is None:
                    continue
                new, over = _sampled(paint.work, at)
                new = in_exposure(new, self._exposures[paint.index], self._exposures[i])
            color, cover = _under(color, cover, new, over)
        return color, cover

    def work_size(self, i: int, picture: NDArray[Any]) -> NDArray[Any]:
        """The working picture (H, W, 3) of frame ``i``, corrected, likewise; of a file's 8 or 16 bits, or float32 in [0, 1]."""
        return _mixed(picture, *self.at_work(i))

    def full_size(self, i: int, picture: NDArray[Any]) -> NDArray[Any]:
        """A delivered picture (H, W), (H, W, 3) or (H, W, 4) of frame ``i``, corrected; elsewhere it is as it was, bit for bit."""
        frame = self._frames[i]
        color, cover = np.zeros((*picture.shape[:2], 3), np.float32), np.zeros(picture.shape[:2], np.float32)
        for paint in self._in_order(i):
            if paint.index == i:
                new, over = paint.whole[..., :3], paint.whole[..., 3]
            else:
                at = self._positions(i, paint)
                if at is None:
                    continue
                there = _enlarged(at, frame)
                there = picture_positions(self._footage(paint.index), self._frames[paint.index].camera, there)
                new, over = _sampled(paint.whole, there)
                new = in_exposure(new, self._exposures[paint.index], self._exposures[i])
            color, cover = _under(color, cover, new, over)
        return _mixed(picture, color, cover)

    def of_points(self, points: Float64) -> tuple[Float32, Float32]:
        """Canonical colours (N, 3) in [0, 1] of places (N, 3) of the empty street, and how far they are corrected (N,)."""
        color, cover = np.zeros((len(points), 3), np.float32), np.zeros(len(points), np.float32)
        for paint in reversed(self._paints):  # an earlier one covers
            index, pixels = shown_in(self._views[paint.index], points, paint.work[..., 3] > COVERED)
            found = sample_at(paint.work, pixels)
            index, found = index[found[:, 3] > 0.5], found[found[:, 3] > 0.5]
            color[index] = in_exposure(found[:, :3], self._exposures[paint.index], IDENTITY)
            cover[index] = found[:, 3]
        return color, cover

    def touches(self, i: int) -> bool:
        """Whether frame ``i`` may show anything that was corrected."""
        here = self._frames[i].camera.centre
        return any(np.linalg.norm(self._frames[p.index].camera.centre - here) < ASKED_M for p in self._paints)

    def _in_order(self, i: int) -> list[_Paint]:
        return sorted(self._paints, key=lambda paint: paint.index != i)

    def _positions(self, i: int, paint: _Paint) -> Float32 | None:
        """(H, W, 2) of frame ``i``; None where it shows nothing of a correction."""
        there = self._frames[paint.index].camera
        if np.linalg.norm(there.centre - self._frames[i].camera.centre) >= ASKED_M:
            return None
        found = positions_in(self._views[i], self._views[paint.index], paint.work[..., 3] > COVERED)
        return found if np.isfinite(found).any() else None

    def _footage(self, i: int) -> Footage:
        frame = self._frames[i]
        return frame.footage or Footage(frame.image_path, frame.camera)


def _mixed(picture: NDArray[Any], color: Float32, cover: Float32) -> NDArray[Any]:
    """A picture with colours (H, W, 3) over it, as far as they cover it (H, W); elsewhere bit for bit as it was."""
    changed = cover > COVERED
    if not changed.any():
        return picture
    share: Float32 = cover[changed][:, None]
    mixed = as_color(picture)[changed] * (1 - share) + color[changed] * share
    out = picture.copy()
    put_colors(out, changed, mixed)
    return out


def _at_work(whole: Float32, frame: Frame) -> Float32:
    """A painting (h, w, 4) of a delivered picture in the working picture (H, W, 4)."""
    if frame.footage is None:
        return whole
    at = picture_positions(frame.footage, frame.camera, _grid(frame.camera.height, frame.camera.width))
    scale = frame.footage.camera.width / frame.camera.width
    solid = np.dstack([whole[..., :3] * whole[..., 3:], whole[..., 3]])
    if scale > 1:  # a pixel of the working picture is the mean of those that it covers
        solid = cv2.GaussianBlur(solid, (0, 0), 0.4 * scale)
    color, cover = _unmixed(_remap(solid, at))
    return np.dstack([color, cover]).astype(np.float32)


def _at_size(work: Float32, frame: Frame) -> Float32:
    """A painting (H, W, 4) of the working picture in the delivered one (h, w, 4)."""
    if frame.footage is None:
        return work
    solid = np.dstack([work[..., :3] * work[..., 3:], work[..., 3]])
    color, cover = _unmixed(_remap(solid, work_positions(frame.footage, frame.camera)))
    return np.dstack([color, cover]).astype(np.float32)


def _enlarged(at: Float32, frame: Frame) -> Float32:
    """Positions (H, W, 2) that are known for the pixels of the working picture, for those of the delivered one (h, w, 2)."""
    if frame.footage is None:
        return at
    known = np.isfinite(at[..., 0])
    where = work_positions(frame.footage, frame.camera)
    share = np.atleast_3d(_remap(known.astype(np.float32), where))
    mean = _remap(np.where(known[..., None], at, 0).astype(np.float32), where) / np.maximum(share, 1e-6)
    # Where neighbours lead to places far from each other, between them there is nothing.
    torn = np.atleast_3d(_remap(_torn(at, known).astype(np.float32), where)) > 0
    return np.where((share > 0.5) & ~torn, mean, np.nan).astype(np.float32)


def _torn(at: Float32, known: Mask) -> Mask:
    """(H, W) pixels whose neighbours' positions are far from theirs."""
    filled = np.where(known[..., None], at, 0).astype(np.float32)
    torn = np.zeros(known.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(filled, axis=axis)).max(axis=2) > 12
        both = known[1:] & known[:-1] if axis == 0 else known[:, 1:] & known[:, :-1]
        edge = step & both
        if axis == 0:
            torn[1:] |= edge
        else:
            torn[:, 1:] |= edge
    return torn


def _sampled(paint: Float32, at: Float32) -> tuple[Float32, Float32]:
    """Colours (H, W, 3) and opacity (H, W) of a painting at positions (H, W, 2), nothing where these are NaN."""
    known = np.isfinite(at[..., 0])
    solid = np.dstack([paint[..., :3] * paint[..., 3:], paint[..., 3]])
    color, cover = _unmixed(_remap(solid, np.where(known[..., None], at, -10).astype(np.float32)))
    # What the edge of the known cuts off ends softly.
    inward = cv2.distanceTransform(known.astype(np.uint8), cv2.DIST_L2, 3)
    whole = ~grow(~known & grow(cover > COVERED, 2), 2)
    return color, (cover * known * np.where(whole, 1.0, np.clip(inward / 3.0, 0, 1))).astype(np.float32)


def _remap(plane: Float32, at: Float32) -> Float32:
    """A plane (h, w[, C]) at positions (H, W, 2), the centre of the first pixel at 0.5; nothing outside of it."""
    return resampled(plane, at, border=cv2.BORDER_CONSTANT)


def _unmixed(solid: Float32) -> tuple[Float32, Float32]:
    """Colours (H, W, 3) and opacity (H, W) of colours that were multiplied by it."""
    cover = np.clip(solid[..., 3], 0, 1)
    cover = np.where(cover > COVERED, cover, 0)
    return np.clip(solid[..., :3] / np.maximum(solid[..., 3:], 1e-6), 0, 1), cover


def _under(color: Float32, cover: Float32, new: Float32, over: Float32) -> tuple[Float32, Float32]:
    """A layer laid under what is there already."""
    added = over * (1 - cover)
    total = cover + added
    mixed = (color * cover[..., None] + new * added[..., None]) / np.maximum(total, 1e-6)[..., None]
    return mixed.astype(np.float32), total.astype(np.float32)


def _grid(height: int, width: int) -> Float32:
    """(H, W, 2) positions of the centres of pixels."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.dstack([x, y]).astype(np.float32)
