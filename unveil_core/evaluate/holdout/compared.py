"""A picture against the photograph, once per pixel, and the sums of it over any part of the virtual cars."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.evaluate.detail.lines import Edges, LineMatch, find_edges, match_lines
from unveil_core.evaluate.detail.scores import DetailScore, detail_figures
from unveil_core.evaluate.metrics import SSIM_WINDOW, gradient, psnr_of_mse, rounded, squared_error, ssim_map
from unveil_core.geometry.images import grow

__all__ = ["LEAST_PX", "Compared", "PartSums", "Photograph", "crop_around"]

CROP_MARGIN = 0.25
"""Width of a crop's margin around a car, as a share of the car's longer side: the eye judges a fill by what it continues."""
LEAST_CROP_PX = 64
"""Shortest side of a crop, pixels: below it the last layers of AlexNet and VGG, which LPIPS compares, have hardly a cell."""
LEAST_PX = 64
"""A part of fewer pixels than this in a frame has no LPIPS there: its crop would show the photograph on both sides."""
CLIPPED = (4, 250)
"""Levels up to which, and from which on, a photograph's channel is clipped and its pixel has no colour to compare."""
LEAST_TINTED_PX = 200
"""Fewest pixels over all frames whose mean has a colour."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """What the photograph shows behind the cars of a frame, found once for all methods.

    Attributes:
        picture: (H, W, 3) uint8.
        inside: (H, W) the cars' pixels without their seam, which is neither texture nor line.
        ground: (H, W) where lines are compared; None where no ground is known.
        slope: (H, W) its gradient, levels a pixel; edges: None without ground.
    """

    picture: Picture
    inside: Mask
    ground: Mask | None
    slope: Float64
    edges: Edges | None

    @classmethod
    def of(cls, picture: Picture, region: Mask, ground: Mask | None) -> Photograph:
        """Args: picture (H, W, 3); region (H, W) the cars' pixels; ground (H, W) those with ground behind them."""
        inside = ~grow(~region, 1)
        where = None if ground is None else ground & inside
        return cls(picture, inside, where, gradient(picture), None if where is None else find_edges(picture))


@dataclass(frozen=True, eq=False)
class Compared:
    """A method's picture against the photograph.

    Attributes:
        photograph: the truth; picture: (H, W, 3) uint8.
        error, similarity: (H, W) squared error, and SSIM, which is NaN in pictures smaller than its window.
        slope: (H, W) the picture's gradient, levels a pixel.
        lines: on the ground inside the cars; None where no ground is known.
    """

    photograph: Photograph
    picture: Picture
    error: Float64
    similarity: Float64
    slope: Float64
    lines: LineMatch | None

    @classmethod
    def of(cls, photograph: Photograph, picture: Picture) -> Compared:
        """Args: photograph and picture (H, W, 3) of one size."""
        truth = photograph.picture
        error = squared_error(picture, truth)
        similar = ssim_map(picture, truth) if min(error.shape) >= SSIM_WINDOW else np.full(error.shape, np.nan)
        lines = None
        if photograph.edges is not None and photograph.ground is not None:
            lines = match_lines(photograph.edges, find_edges(picture), photograph.ground)
        return cls(photograph, picture, error, similar, gradient(picture), lines)

    def detail(self, part: Mask) -> DetailScore:
        """Gradients and lines of a part (H, W) of the cars."""
        inside = part & self.photograph.inside
        counts = (0, 0, 0, 0)
        if (at := self.lines) is not None:
            found, missed, right, false = (int((m & inside).sum()) for m in (at.found, at.missed, at.right, at.false))
            counts = (found, missed, right, false)
        return DetailScore(
            int(inside.sum()), float(self.slope[inside].sum()), float(self.photograph.slope[inside].sum()), *counts
        )

    def crop(self, part: Mask, around: tuple[slice, slice]) -> tuple[Picture, Picture]:
        """The picture in a part (H, W) pasted into the photograph, and the photograph, cropped to ``around``."""
        truth = self.photograph.picture[around]
        return np.where(part[around][..., None], self.picture[around], truth), truth

    def colors(self, part: Mask) -> Float64:
        """(2, 4) sums over the ground of a part (H, W), where the photograph is not clipped: red, green, blue and count of pixels,
        of the picture and of the photograph."""
        truth = self.photograph.picture
        low, high = CLIPPED
        where = np.zeros(part.shape, bool) if self.photograph.ground is None else part & self.photograph.ground
        where &= (truth > low).all(axis=2) & (truth < high).all(axis=2)
        return np.array([[*p[where].sum(axis=0, dtype=np.float64), where.sum()] for p in (self.picture, truth)])


@dataclass
class PartSums:
    """Sums over frames of one method in one part of the cars."""

    squared: float = 0.0
    similar: float = 0.0
    pixels: int = 0
    frames: int = 0
    details: list[DetailScore] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    colors: Float64 = field(default_factory=lambda: np.zeros((2, 4)))

    def add(self, compared: Compared, part: Mask, lpips: float | None = None) -> None:
        """Add a frame; part: (H, W) with at least one pixel."""
        self.squared += float(compared.error[part].sum())
        self.similar += float(compared.similarity[part].sum())
        self.pixels += int(part.sum())
        self.frames += 1
        self.details.append(compared.detail(part))
        self.colors += compared.colors(part)
        if lpips is not None:
            self.distances.append(lpips)

    @property
    def lpips(self) -> float:
        """Mean over frames; NaN where there was none."""
        return sum(self.distances) / len(self.distances) if self.distances else math.nan

    @property
    def tint(self) -> float:
        """How far apart the mean colours of the ground are, whatever their lightness: distance in a* and b* of CIELAB; NaN where
        too little ground is not clipped."""
        count = self.colors[0, 3]
        if count < LEAST_TINTED_PX:
            return math.nan
        means = (self.colors[:, None, :3] / count / 255).astype(np.float32)
        ours, truth = cv2.cvtColor(means, cv2.COLOR_RGB2LAB)[:, 0, 1:].astype(np.float64)
        return float(np.hypot(*(ours - truth)))

    def figures(self, lpips: float | None = None) -> dict[str, Any]:
        """For JSON. ``lpips``: a mean that was taken otherwise than over frames; NaN is left out."""
        detail = detail_figures(self.details)
        distance = self.lpips if lpips is None else lpips
        figures = {
            "psnr": psnr_of_mse(self.squared / self.pixels),
            "ssim": self.similar / self.pixels,
            **{name: value for name, value in (("lpips", distance), ("tint", self.tint)) if not math.isnan(value)},
            **{name: detail[name] for name in ("gradient", "line_recall", "false_lines")},
            "frames": self.frames,
        }
        found: dict[str, Any] = rounded(figures)
        return found


def crop_around(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of a crop around a mask (H, W) that is not empty: its box with a margin, of no less than
    :data:`LEAST_CROP_PX` a side where the picture has so much, and inside the picture."""
    boxes = [np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0)]
    longer = max(int(at[-1]) + 1 - int(at[0]) for at in boxes)
    sides = []
    for at, size in zip(boxes, mask.shape, strict=True):
        low, high = int(at[0]), int(at[-1]) + 1
        side = min(size, max(LEAST_CROP_PX, high - low + 2 * round(CROP_MARGIN * longer)))
        start = min(max((low + high - side) // 2, 0), size - side)
        sides.append(slice(start, start + side))
    return sides[0], sides[1]
