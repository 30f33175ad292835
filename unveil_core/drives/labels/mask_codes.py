"""What a drive's masks hold: levels or transparency, exact or changed a little, and which end of the levels is removed.

nerfstudio and COLMAP remove what is black; Instant-NGP's dynamic masks, and many programs that cut things out, have it the other
way round. Nothing in a mask tells which is meant but how much would go, so black is taken unless the user says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.labels.codes import BLACK, WHITE, MaskCode
from unveil_core.drives.labels.reading import levels_of, removed
from unveil_core.drives.labels.samples import Sample

__all__ = ["TURNED_ROUND", "mask_code"]

TURNED_ROUND = {
    BLACK: "black and transparent is removed, as nerfstudio and COLMAP have it; --mask-removes white turns it round",
    WHITE: "white is removed, as Instant-NGP has it; --mask-removes black turns it round",
}
"""What is removed of masks of which nobody says it, and what to do where it is meant otherwise."""

HALF = 127
"""Between black and white."""
NEAR_BLACK = 24
"""Levels that JPEG makes of black beside an edge, at the qualities that people save with."""
MOST_MASK_COLOURS = 32
"""A picture with more is a photograph that was cut out, not a mask."""
FEW = 0.02
"""Share of pixels between black and white, in masks that know only the two."""


def mask_code(samples: Sequence[Sample], removes: str | None = None, usual: str = BLACK) -> tuple[MaskCode, list[str]]:
    """What masks hold.

    Args:
        samples: some of them.
        removes: "black" or "white", where the user says it; usual: what the format has, where nobody does.
    Returns:
        the code, and what a user should know of it, a line each.
    """
    told = []
    by_alpha = _told_by_alpha(samples)
    if by_alpha:
        told.append(
            "masks are taken from the transparency of their pictures, whose colours tell nothing: transparent = remove"
        )
    levels = _levels(samples, MaskCode(by_alpha=by_alpha))
    code = MaskCode(removes or usual, by_alpha, _up_to(samples, levels))
    if code.up_to:
        told.append(f"masks are of a lossy format: levels up to {code.up_to} count as black")
    if samples and removes is None and not any(removed(s.small, code).any() for s in samples):
        told.append(f"masks remove nothing: {TURNED_ROUND[usual]}")
    return code, told


def _told_by_alpha(samples: Sequence[Sample]) -> bool:
    """Whether transparency differs within pictures whose colours do not, or are those of a photograph."""
    clear = [s for s in samples if s.small.pixels.ndim == 3 and s.small.pixels.shape[2] == 4]
    if not clear or len(clear) < len(samples):
        return False
    if not any(np.ptp(s.small.pixels[..., 3]) for s in clear):
        return False
    opaque = [s.small.pixels[s.small.pixels[..., 3] > 0][:, :3] for s in clear]
    colours = np.unique(np.concatenate(opaque), axis=0)
    return len(colours) <= 1 or len(colours) > MOST_MASK_COLOURS


def _levels(samples: Sequence[Sample], code: MaskCode) -> NDArray[np.int64]:
    """(256,) pixels by level."""
    counts = np.zeros(256, dtype=np.int64)
    for sample in samples:
        levels = levels_of(sample.small, code)
        counts += np.bincount((levels >> 8 if levels.dtype == np.uint16 else levels).ravel(), minlength=256)
    return counts


def _up_to(samples: Sequence[Sample], levels: NDArray[np.int64]) -> int:
    """The largest level that is black: 0 of exact masks, whose soft borders are kept."""
    total = max(int(levels.sum()), 1)
    white = int(levels[256 - NEAR_BLACK :].sum())
    between = total - white - int(levels[:NEAR_BLACK].sum())
    two = white > 0 and between < FEW * total
    # An exact mask that became a PNG again after it was a JPEG has a ring of near black about everything black.
    ring = int(levels[1:NEAR_BLACK].sum())
    lossy = any(s.small.lossy for s in samples) or (ring > 0 and ring > between and ring * 4 > int(levels[0]))
    return HALF if two and lossy else 0
