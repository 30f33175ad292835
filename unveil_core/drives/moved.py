"""Which tracked objects of a drive moved."""

from __future__ import annotations

from unveil_core.drives.boxes import TrackedBox, has_moved
from unveil_core.drives.drive import Drive

__all__ = ["moved_ids"]


def moved_ids(drive: Drive) -> frozenset[int]:
    """Ids of the boxes, in frames and sweeps, that are not always at one place."""
    found: dict[int, list[TrackedBox]] = {}
    for boxes in (*(f.boxes for f in drive.frames), *(s.boxes for s in drive.sweeps)):
        for box in boxes:
            found.setdefault(box.id, []).append(box)
    return frozenset(number for number, boxes in found.items() if has_moved(boxes))
