"""Reading pickles of datasets without running what a stranger put into them.

A pickle is a program: it may call anything that it names. Here it may name only what arrays and tables of numbers need, and
gets stand-ins for all of these, which keep what they are given; everything else is refused before anything is called. NumPy's
own types are no exception: their ``__setstate__`` takes a stranger's word for how wide a number is and whether it is a pointer.
Arrays are made of what the stand-ins hold, once it was checked. Python's own unpickler is used, not the one in C, which makes
room for whatever a pickle announces. What a pickle may cost is bounded beside: its steps, the bytes that it makes, the digits of
its numbers, and what its lists come to when each is written out wherever it is named.
"""

from __future__ import annotations

import gzip
import io
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import NO_ARCHIVE
from unveil_core.drives.formats.pickled import stand_ins
from unveil_core.drives.formats.pickled.plain import Plain
from unveil_core.drives.formats.pickled.stand_ins import ARRAYS, StandIn, made_bytes
from unveil_core.drives.formats.pickled.unpickler import Restricted

__all__ = ["ARRAYS", "StandIn", "read_admitted", "read_archived_object", "read_arrays"]

FIRST_BYTES, MOST_UNPACKED = 64 << 20, 200
"""Beyond the first bytes, how many one packed byte unpacks to at most. Labels of a sweep, all but alike, make fifty."""
PIECE_BYTES = 1 << 20


def read_admitted(path: Path, admitted: Mapping[tuple[str, str], Any]) -> Any:
    """What a pickle holds, packed by gzip or not.

    Args:
        admitted: what it may name, by module and name, and what it gets for that.
    Raises:
        DriveError: missing, cut short, too large, or naming anything else; nothing is run then.
    """
    try:
        with open_file(path) as file:
            packed = file.read(2) == b"\x1f\x8b"
            most = _most_of(os.fstat(file.fileno()).st_size) if packed else stand_ins.MOST_BYTES
            file.seek(0)
            content = _all_of(gzip.GzipFile(fileobj=file) if packed else file, most)
    except FileNotFoundError as error:
        raise DriveError("Not found", path=path, mend="download it again") from error
    except (OSError, EOFError, zlib.error) as error:
        raise DriveError(f"Cut short or damaged: {error}", path=path, mend="download it again") from error
    if len(content) > most:
        raise DriveError(f"unpacks to more than {most >> 20:,} MB", path=path, mend="download it again")
    return _unpickled(io.BytesIO(content), admitted, path)


def _most_of(packed: int) -> int:
    """Bytes that a file of so many packed ones may unpack to."""
    return min(stand_ins.MOST_BYTES, FIRST_BYTES + MOST_UNPACKED * packed)


def _all_of(stream: Any, most: int) -> bytearray:
    """What a stream holds, or just more than ``most`` bytes of it. Piece by piece: for one read of so many bytes, room for all of
    them is taken first."""
    held = bytearray()
    while len(held) <= most and (piece := stream.read(min(PIECE_BYTES, most + 1 - len(held)))):
        held += piece
    return held


def _unpickled(stream: io.BytesIO, admitted: Mapping[tuple[str, str], Any], path: Path) -> Any:
    counted = made_bytes.set([0])
    try:
        return Plain().of(Restricted(stream, admitted).load())
    except MemoryError as error:
        raise DriveError("asks for more memory than there is", path=path, mend="download it again") from error
    except Exception as error:  # whatever a damaged or hostile pickle makes go wrong is that file's fault
        raise DriveError(f"Not a readable pickle: {error}", path=path, mend="download it again") from error
    finally:
        made_bytes.reset(counted)


def read_arrays(path: Path) -> Any:
    """A pickle of dicts, lists, numbers, strings and NumPy arrays, packed by gzip or not.

    Raises:
        DriveError: missing, cut short, or naming anything else; nothing is run then.
    """
    return read_admitted(path, ARRAYS)


def read_archived_object(path: Path, name: str) -> Any:
    """The one object that an array of an .npz holds, which NumPy keeps there as a pickle; as :func:`read_arrays`.

    Raises:
        DriveError: missing, cut short, no such object, or naming anything else; nothing is run then.
    """
    try:
        with open_file(path) as file, zipfile.ZipFile(file) as packed:
            about = packed.getinfo(f"{name}.npy")
            if about.file_size > _most_of(about.compress_size):
                raise DriveError(f"unpacks to {about.file_size >> 20:,} MB", path=path, mend="download it again")
            stream = io.BytesIO(packed.read(f"{name}.npy"))
        version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = header(stream)  # type: ignore[no-untyped-call]
    except KeyError as error:
        raise DriveError(f"lacks an array: {error.args[0]}", path=path, mend="make it again") from error
    except NO_ARCHIVE as error:
        raise DriveError(f"Not an archive of arrays: {error}", path=path, mend="make it again") from error
    if shape != () or not kind.hasobject:
        raise DriveError(f"Not an object: {name} holds an array of {shape} {kind}", path=path, mend="make it again")
    held = _unpickled(stream, ARRAYS, path)
    if not isinstance(held, np.ndarray) or held.shape != ():
        raise DriveError(f"Not an object: {name}", path=path, mend="make it again")
    return held.item()
