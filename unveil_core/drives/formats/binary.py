"""Arrays of numbers in files of datasets: bare floats, and NumPy archives without pickles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.disk.open_safely import LARGEST_FILE, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import NO_ARCHIVE

__all__ = ["read_archive", "read_floats"]

MOST_BYTES = 1 << 30
"""Of the unpacked arrays of an archive: hundred times a sweep's. A few packed bytes can stand for more than fits into memory."""
MEND = "download or make it again"


def read_floats(path: Path, columns: int | None) -> NDArray[np.float32]:
    """(N, columns) of a file of little-endian float32, row by row; (N,) where the columns are not known.

    Raises:
        DriveError: missing, or no whole number of rows.
    """
    width = columns or 1
    try:
        size = path.stat().st_size
        if size % (4 * width):
            problem = f"Cut short: {size} bytes do not make rows of {width} numbers"
            raise DriveError(problem, path=path, mend=MEND)
        with open_file(path, LARGEST_FILE) as stream:
            values = np.fromfile(stream, dtype="<f4")
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend=MEND) from error
    return values if columns is None else values.reshape(-1, columns)


def read_archive(path: Path, names: Sequence[str]) -> list[NDArray[Any]]:
    """Arrays of an .npz by name. Arrays of objects, which would have to be unpickled, are refused.

    Raises:
        DriveError: missing, cut short, too large, without one of the arrays, or with objects.
    """
    try:
        with open_npz(path, names, MOST_BYTES, links=True) as archive:
            return [np.asarray(archive[name]) for name in names]
    except KeyError as error:
        raise DriveError(f"lacks an array: {error.args[0]}", path=path, mend=MEND) from error
    except NO_ARCHIVE as error:
        raise DriveError(f"Not an archive of arrays: {error}", path=path, mend=MEND) from error
