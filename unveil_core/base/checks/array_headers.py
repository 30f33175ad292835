"""What NumPy's files claim to hold, compared with what is there before anything is taken from memory for it."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file

__all__ = ["check_npy", "load_npy", "open_npz"]

NUMBERS = "biufcSU"
"""Kinds of arrays that are read: numbers and texts, no objects, which would be unpickled."""


@contextmanager
def open_npz(
    path: Path, names: Sequence[str] | None = None, most_bytes: int | None = None, *, links: bool = False
) -> Iterator[Any]:
    """An archive of arrays, open to be read after its headers were checked; which other errors a damaged one makes tells
    :data:`unveil_core.base.files.NO_ARCHIVE`.

    Args:
        names: of the arrays that are read; None = all.
        most_bytes: of them together, unpacked.
        links: whether a symbolic link is followed, see :func:`open_file`.
    Raises:
        KeyError: it lacks one.
        ValueError: one is no array of numbers, or has other than so many; or they are too large.
    """
    with open_file(path, links=links) as stream:
        _check_npz(stream, names, most_bytes)
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            yield archive


def load_npy(path: Path, *, links: bool = False) -> NDArray[Any]:
    """The array of numbers in a file, after its header was checked.

    Args:
        links: see :func:`open_npz`.
    Raises:
        ValueError: it is no array of numbers, or has other than so many.
    """
    with open_file(path, links=links) as stream:
        check_npy(stream, os.fstat(stream.fileno()).st_size)
        stream.seek(0)
        array: NDArray[Any] = np.load(stream, allow_pickle=False)
        return array


def _check_npz(file: BinaryIO, names: Sequence[str] | None, most_bytes: int | None) -> None:
    with zipfile.ZipFile(file) as packed:
        parts = packed.infolist() if names is None else [packed.getinfo(f"{name}.npy") for name in names]
        if most_bytes is not None and sum(part.file_size for part in parts) > most_bytes:
            raise ValueError(f"it unpacks to more than {most_bytes:,} bytes")
        for part in parts:
            with packed.open(part) as stream:
                check_npy(stream, part.file_size)


def check_npy(stream: BinaryIO | Any, size: int) -> None:
    """Check one array from its beginning on; the stream is left behind its header.

    Args:
        size: bytes that there are.
    Raises:
        ValueError: it is no array of numbers, or has other than so many.
    """
    version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"it is of version {version}")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    try:
        shape, _, kind = read(stream)  # type: ignore[no-untyped-call]
    except (MemoryError, RecursionError):  # so Python says that brackets lie too deep within one another
        raise ValueError("its header is none") from None
    sound = kind.kind in NUMBERS and min(shape, default=0) >= 0
    if not sound or math.prod(shape) * kind.itemsize != size - stream.tell():
        raise ValueError(f"it says {str(shape)[:60]} {kind} in {size:,} bytes")
