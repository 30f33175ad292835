"""A few of a drive's label pictures, small, to find out what they hold; remembered while their files stay the same."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import Values, read_values
from unveil_core.drives.labels.reading import ids_of

__all__ = ["Sample", "samples_of"]

MOST = 9
"""Pictures that are looked at, evenly chosen, first and last included: numbers of all usual classes are in any two of them."""
ROWS = 96
"""Of a small picture about."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Of one picture.

    Attributes:
        path: of the file.
        small: every so many-th pixel of every so many-th row.
        ids: all numbers that the whole picture has; None of one in colours. shades: likewise, of a picture with a palette the grey
            levels that its numbers point to; None where they are colours, or where there is no palette.
    """

    path: Path
    small: Values
    ids: NDArray[np.int64] | None
    shades: NDArray[np.int64] | None


def samples_of(paths: Iterable[Path]) -> list[Sample]:
    """Samples of some of the pictures; of those that cannot be read none: whoever reads them says so."""
    files = list(paths)
    chosen = sorted({round(i * (len(files) - 1) / (MOST - 1)) for i in range(MOST)}) if files else []
    found = []
    for k in chosen:
        with suppress(OSError, DriveError):
            stat = os.stat(files[k])
            found.append(_sample(files[k], stat.st_size, stat.st_mtime_ns))
    return found


@lru_cache(maxsize=128)
def _sample(path: Path, _size: int, _changed: int) -> Sample:
    values = read_values(path)
    step = max(1, values.pixels.shape[0] // ROWS)
    ids = ids_of(values)
    shades = None if values.palette is None else ids_of(values, by_palette=True)
    small: Any = np.ascontiguousarray(values.pixels[::step, ::step])
    return Sample(
        path,
        replace(values, pixels=small),
        None if ids is None else np.unique(ids).astype(np.int64),
        None if shades is None else np.unique(shades).astype(np.int64),
    )
