"""Provenance and certainty of a delivery: which share comes from where, how good that is, and whether "sure" means right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.base.types import Picture
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.metrics import psnr_of_mse, squared_error
from unveil_core.inpaint.origin import CONTINUED, INVENTED, ORIGINAL, RELIT, SEEN_ELSEWHERE
from unveil_core.provenance.certainty import CERTAIN, ORIGINAL_LEVEL, RIGHT_LEVELS, right_pixels
from unveil_core.workspace.files import frame_file

__all__ = ["ORIGINS", "ProvenanceScore", "provenance_figures", "score_provenance"]

ORIGINS = {RELIT: "relit", SEEN_ELSEWHERE: "seen_elsewhere", CONTINUED: "continued", INVENTED: "invented"}
"""Names of the origins of what is not the photograph's."""
BINS = (0.0, 0.6, 0.8, 0.9, 0.95)
"""Lower limits of the certainties between which expectation and truth are compared: most pixels are expected to be right, so that
equal parts would say little of them."""


@dataclass
class ProvenanceScore:
    """Sums over the changed pixels of a frame.

    Attributes:
        pixels: by origin; certain: of all of them, those that are called certain; expected: sum of the certainties, 0 to 1.
        true_pixels, squared: by origin, pixels that the truth shows and their squared error.
        bins: (5, 3) of these pixels by certainty: their number, the sum of their certainties, the number of right ones.
        certain_pixels, certain_right: of these pixels those called certain, and of them the right ones.
    """

    pixels: dict[int, int] = field(default_factory=dict)
    certain: int = 0
    expected: float = 0.0
    true_pixels: dict[int, int] = field(default_factory=dict)
    squared: dict[int, float] = field(default_factory=dict)
    bins: np.ndarray = field(default_factory=lambda: np.zeros((len(BINS), 3)))
    certain_pixels: int = 0
    certain_right: int = 0


def score_provenance(root: Path, frame: Frame, delivered: Picture, street: Picture | None) -> ProvenanceScore | None:
    """Measure one frame; None where the workspace does not tell its provenance.

    Args:
        root: the workspace; delivered: (H, W, 3); street: (H, W, 3) the true empty street, or None.
    """
    paths = [frame_file(root / name, frame) for name in ("provenance", "certainty")]
    if not all(p.is_file() for p in paths):
        return None
    origin, level = (read_label_image(p) for p in paths)
    if origin.shape != delivered.shape[:2] or level.shape != origin.shape:
        return None
    changed = origin != ORIGINAL
    expected = np.minimum(level[changed].astype(np.float64) / (ORIGINAL_LEVEL - 1), 1.0)
    kinds, certain = origin[changed], level[changed] >= CERTAIN
    score = ProvenanceScore(
        pixels={k: int(np.count_nonzero(kinds == k)) for k in ORIGINS},
        certain=int(np.count_nonzero(certain)),
        expected=float(expected.sum()),
    )
    if street is not None:
        error, right = squared_error(delivered, street)[changed], right_pixels(delivered, street)[changed]
        score.true_pixels = dict(score.pixels)
        score.squared = {k: float(error[kinds == k].sum()) for k in ORIGINS}
        number = np.searchsorted(BINS, expected, side="right") - 1
        weights = (None, expected, right.astype(np.float64))
        score.bins = np.stack([np.bincount(number, w, minlength=len(BINS)) for w in weights], axis=1).astype(np.float64)
        score.certain_pixels = score.certain
        score.certain_right = int(np.count_nonzero(certain & right))
    return score


def provenance_figures(scores: Sequence[ProvenanceScore]) -> dict[str, Any]:
    """``provenance`` and ``certainty`` of a drive; empty where nothing was changed.

    Returns:
        ``provenance``: ``pixels`` that were changed, and by origin their ``share`` and, with truth, ``psnr``. ``certainty``:
        ``expected`` share of right pixels, share called ``certain``, both with what they mean (``certain_from``, a level of the
        images, and ``right_within`` levels of 255); with truth ``right``, ``certain_right``, ``calibration_error`` (mean
        difference of expected and actual share over the bins, by their size), and ``bins``.
    """
    pixels = {k: sum(s.pixels.get(k, 0) for s in scores) for k in ORIGINS}
    count = sum(pixels.values())
    if not count:
        return {}
    truth = {k: sum(s.true_pixels.get(k, 0) for s in scores) for k in ORIGINS}
    origins: dict[str, dict[str, float]] = {}
    for kind, name in ORIGINS.items():
        origins[name] = {"share": pixels[kind] / count}
        if truth[kind]:
            origins[name]["psnr"] = psnr_of_mse(sum(s.squared.get(kind, 0.0) for s in scores) / truth[kind])
    certainty: dict[str, Any] = {
        "expected": sum(s.expected for s in scores) / count,
        "certain": sum(s.certain for s in scores) / count,
        "certain_from": CERTAIN,
        "right_within": RIGHT_LEVELS,
    }
    bins = np.sum([s.bins for s in scores], axis=0)
    known = float(bins[:, 0].sum())
    if known:
        called = sum(s.certain_pixels for s in scores)
        certainty["right"] = float(bins[:, 2].sum()) / known
        certainty["certain_right"] = sum(s.certain_right for s in scores) / called if called else math.nan
        certainty["calibration_error"] = float(np.abs(bins[:, 1] - bins[:, 2]).sum()) / known
        certainty["bins"] = [
            {"from": BINS[k], "pixels": int(n), "expected": e / n, "right": r / n}
            for k, (n, e, r) in enumerate(bins.tolist())
            if n
        ]
    return {"provenance": {"pixels": count, "origins": origins}, "certainty": certainty}
