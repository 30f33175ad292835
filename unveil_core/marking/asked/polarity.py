"""Which part of a matte is the object: told by names, else by what is plausible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from unveil_core.base.evenly import evenly
from unveil_core.base.pictures.decoding import read_image

__all__ = ["polarity"]

OF_BLACK = {"inv", "inverse", "inverted", "invert", "holdout", "keep", "background", "bg", "cleanplate"}
OF_WHITE = {"matte", "mattes", "alpha", "roto", "fg", "foreground", "remove", "garbage", "object"}
"""Words in names of files and folders of mattes whose black, or white, is the object."""
LOOKED_AT = 8
MOST = 0.5
"""Share of the picture from which on what is white, in the median, is taken for what stays."""


def polarity(folder: Path, files: Sequence[Path]) -> str:
    """ "white" or "black".

    Args:
        folder: of the mattes, whose name counts; files: of them.
    Raises:
        DriveError: one cannot be read.
    """
    words = {w for name in (folder.name, files[0].stem) for w in re.split(r"[^a-z]+", name.lower())}
    if words & OF_BLACK:
        return "black"
    some = [read_image(files[i]).max(axis=2) > 127 for i in evenly(len(files), LOOKED_AT)]
    shares = [float(m.mean()) for m in some if m.any() and not m.all()]
    if not shares or words & OF_WHITE and min(shares) < MOST:
        return "white"
    return "black" if float(np.median(shares)) > MOST else "white"
