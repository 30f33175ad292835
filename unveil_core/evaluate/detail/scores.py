"""The details of one frame against the true empty street, as sums that can be pooled over frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.types import Float64, Labels, Mask, Picture
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.detail.ground_pixels import ground_pixels
from unveil_core.evaluate.detail.lines import LineMatch, find_edges, match_lines
from unveil_core.evaluate.detail.residue import PATCH_PX, find_residue, nearest_object
from unveil_core.evaluate.detail.spectrum import BANDS_PX, Spectrum
from unveil_core.evaluate.metrics import gradient
from unveil_core.geometry.images import area_px, border_px, grow, smoothed

__all__ = ["DETAIL_FIGURES", "SPECTRUM_FIGURES", "DetailScore", "PictureDetail", "StreetDetail", "detail_figures"]

SEAM_PX = 1
"""Pixels next to a region's border that count neither for gradient nor for lines: a seam is no texture, and no line."""
AROUND_PX = 24
"""Rows above and below all regions that are looked at, pixels at 384 px: twice the length of the shortest line, so that a line that
enters a region keeps its length."""
SPECTRUM_FIGURES = tuple(f"spectrum_{wavelength}px" for wavelength in BANDS_PX)
"""Names of the bands of the spectrum, by their longest wavelength."""
DETAIL_FIGURES = ("gradient", *SPECTRUM_FIGURES, "line_recall", "false_lines", "residue")
"""Names of the figures, in the order of tables."""


@dataclass(frozen=True)
class DetailScore:
    """Sums of one method over one region.

    Attributes:
        pixels: of the region.
        gradient, true_gradient: over the region without its seam, levels.
        found, missed: pixels of true lines. right, false: pixels of the method's lines.
        residue: pixels that still show a removed object.
        fine, middle, coarse, true_fine, true_middle, true_coarse: energy of the bands of the spectrum, from the finest one, over
            the region without its seam, squared levels.
    """

    pixels: int = 0
    gradient: float = 0.0
    true_gradient: float = 0.0
    found: int = 0
    missed: int = 0
    right: int = 0
    false: int = 0
    residue: int = 0
    fine: float = 0.0
    middle: float = 0.0
    coarse: float = 0.0
    true_fine: float = 0.0
    true_middle: float = 0.0
    true_coarse: float = 0.0


@dataclass(frozen=True, eq=False)
class PictureDetail:
    """A picture against the true street.

    Attributes:
        scores: sums by region.
        lines: on the ground of all regions.
        residue: (H, W) pixels of any region that still show a removed object.
    """

    scores: dict[str, DetailScore]
    lines: LineMatch
    residue: Mask


def detail_figures(scores: Iterable[DetailScore]) -> dict[str, float]:
    """The figures of pooled sums: gradient, spectrum and ``line_recall``, right at 1, ``false_lines`` and ``residue``, right at 0.

    Returns:
        ``gradient``: gradient energy as a ratio to the truth's; ``spectrum_4px`` and so on (:data:`SPECTRUM_FIGURES`): root of a
        band's energy as a ratio to the truth's, so in amplitude as the gradient; ``line_recall``: share of true line pixels that
        were found; ``false_lines``: share of the method's line pixels that are at no true edge; ``residue``: share of the
        region's pixels. NaN where there is nothing to compare, so for lines where no ground is known.
    """
    values = [astuple(score) for score in scores]
    total = DetailScore(*(sum(column) for column in zip(*values, strict=True))) if values else DetailScore()
    ours = total.fine, total.middle, total.coarse
    true = total.true_fine, total.true_middle, total.true_coarse
    return {
        "gradient": _share(total.gradient, total.true_gradient),
        **{name: math.sqrt(_share(*both)) for name, *both in zip(SPECTRUM_FIGURES, ours, true, strict=True)},
        "line_recall": _share(total.found, total.found + total.missed),
        "false_lines": _share(total.false, total.right + total.false),
        "residue": _share(total.residue, total.pixels),
    }


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def _sum_inside(values: Float64, mask: Mask) -> float:
    """The sum of (H, W) values inside a mask; faster than by an index."""
    return float(cv2.mean(values, mask.astype(np.uint8))[0]) * int(np.count_nonzero(mask))


def _rows_of(masks: Sequence[Mask]) -> slice:
    """The rows of all masks (H, W), and some around them."""
    rows = np.flatnonzero(np.logical_or.reduce([mask.any(axis=1) for mask in masks])) if masks else np.empty(0, int)
    if not len(rows):
        return slice(0, 0)
    around = border_px(masks[0].shape[1], AROUND_PX)
    return slice(max(0, int(rows[0]) - around), int(rows[-1]) + 1 + around)


class StreetDetail:
    """What the true street of a frame shows, found once for all methods.

    Args:
        truth: folder of the truth; frame: of the imported drive.
        street, crowded: (H, W, 3) the true empty street and the photograph.
        regions: (H, W) by name, as ``evaluate.pictures.regions_of`` gives them; ``whole`` is left out.
    Raises:
        DriveError: a file of the truth that cannot be read.
    """

    def __init__(
        self, truth: Path, frame: Frame, street: Picture, crowded: Picture, regions: Mapping[str, Mask]
    ) -> None:
        self._shape = street.shape[:2]
        regions = {name: mask for name, mask in regions.items() if name != "whole" and mask.any()}
        self._rows = _rows_of(list(regions.values()))
        self._regions = {name: mask[self._rows] for name, mask in regions.items()}
        if not regions:
            return
        where: Mask = np.logical_or.reduce(list(regions.values()))
        ground = ground_pixels(truth, frame, where)
        compared = np.zeros_like(where) if ground is None else ground & ~grow(~where, SEAM_PX)
        self._where, self._ground = where[self._rows], compared[self._rows]
        self._inside = {name: ~grow(~mask, SEAM_PX)[self._rows] for name, mask in regions.items()}
        street, crowded = street[self._rows], crowded[self._rows]
        slope = gradient(street)
        self._gradient = {name: _sum_inside(slope, inside) for name, inside in self._inside.items()}
        self._spectrum = {name: Spectrum(inside) for name, inside in self._inside.items()}
        self._energies = {name: spectrum.energies(street) for name, spectrum in self._spectrum.items()}
        self._edges = find_edges(street)
        self._street, self._crowded = smoothed(street), smoothed(crowded)
        self._patch_px = area_px(self._shape, PATCH_PX)

    def compare(self, picture: Picture) -> PictureDetail:
        """A method's picture (H, W, 3) against the true street; no sums for empty regions."""
        if not self._regions:
            nothing = np.zeros(self._shape, dtype=bool)
            return PictureDetail({}, LineMatch(nothing, nothing, nothing, nothing), nothing)
        picture = picture[self._rows]
        slope = gradient(picture)
        lines = match_lines(self._edges, find_edges(picture), self._ground)
        left = find_residue(smoothed(picture), self._crowded, self._street, self._where, patch_px=self._patch_px)
        counted = (lines.found, lines.missed, lines.right, lines.false, left)
        scores = {}
        for name, region in self._regions.items():
            slopes = _sum_inside(slope, self._inside[name]), self._gradient[name]
            counts = (int(np.count_nonzero(mask & region)) for mask in counted)
            energies = *self._spectrum[name].energies(picture), *self._energies[name]
            scores[name] = DetailScore(int(np.count_nonzero(region)), *slopes, *counts, *energies)
        *of_lines, residue = (self._whole(mask) for mask in counted)
        return PictureDetail(scores, LineMatch(*of_lines), residue)

    def _whole(self, mask: Mask) -> Mask:
        """(H, W) of a mask of the rows that are looked at."""
        whole = np.zeros(self._shape, dtype=bool)
        whole[self._rows] = mask
        return whole

    def residue_by_object(self, left: Mask, instances: Labels) -> dict[int, tuple[int, int]]:
        """By object: pixels that still show it, and pixels that it and its shadow cover.

        Args:
            left: (H, W) the residue of a picture; instances: (H, W) ids of the removed objects, 0 none.
        """
        if not self._regions or not instances.any():
            return {}
        where = self._whole(self._where)
        owner = nearest_object(instances)
        pixels = np.bincount(owner[where])
        remaining = np.bincount(owner[where & left], minlength=len(pixels))
        return {int(i): (int(remaining[i]), int(pixels[i])) for i in np.flatnonzero(pixels) if i}
