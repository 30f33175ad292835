"""What a transforms.json leaves out of its coordinates: ``shift``, as Unveil exports it for programs of single precision."""

from __future__ import annotations

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.geometry.similarity import Similarity

__all__ = ["shift_told"]


def shift_told(keys: Keys) -> Similarity:
    """From the coordinates of a file to those that it was made from; the identity where it tells no shift.

    Raises:
        DriveError: it is something else than three numbers.
    """
    if keys.get("shift") is None:
        return Similarity()
    try:
        shift = np.asarray(keys.get("shift"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        shift = np.zeros(0)
    if shift.shape != (3,) or not np.isfinite(shift).all():
        raise DriveError("Not three numbers: shift", path=keys.path, mend="correct it, or leave it out")
    return Similarity(translation=shift)
