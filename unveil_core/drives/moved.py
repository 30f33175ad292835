"""Which tracked objects of a drive moved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.drive import Drive

__all__ = ["moved_ids"]

MOVED_SHARE, MOVED_M = 0.25, 0.3
"""An object moved if its box did by more than this share of its length plus this many metres: annotated boxes wander a little."""


def moved_ids(drive: Drive) -> frozenset[int]:
    """Ids of the boxes, in frames and sweeps, that are not always at one place."""
    centres: dict[int, list[NDArray[np.float64]]] = {}
    lengths: dict[int, float] = {}
    for boxes in (*(f.boxes for f in drive.frames), *(s.boxes for s in drive.sweeps)):
        for box in boxes:
            centres.setdefault(box.id, []).append(np.asarray(box.centre))
            lengths[box.id] = max(lengths.get(box.id, 0.0), *box.size[:2])
    return frozenset(
        number
        for number, places in centres.items()
        if float(np.linalg.norm(np.ptp(np.array(places), axis=0))) > MOVED_SHARE * lengths[number] + MOVED_M
    )
