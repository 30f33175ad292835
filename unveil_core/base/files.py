"""Reading and writing files: atomically, with one clear line when something is wrong."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
import time
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.new_files import mode_like, new_file
from unveil_core.base.disk.open_safely import LARGEST_STATE, LARGEST_TEXT, RefusedFileError, open_file, read_bytes
from unveil_core.base.errors import DriveError, WorkspaceError
from unveil_core.base.pictures.metadata import Metadata

__all__ = [
    "LEAST_ROOM",
    "NO_ARCHIVE",
    "copy_picture",
    "full_disk",
    "is_out_of_gpu_memory",
    "is_out_of_memory",
    "move",
    "parsed_json",
    "patiently",
    "read_json",
    "read_own_json",
    "write_atomic",
    "write_bytes_atomic",
    "write_image_atomic",
    "write_json_atomic",
]

NO_ARCHIVE = (
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    SyntaxError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    AttributeError,
    TypeError,
    ArithmeticError,
)
"""What numpy and zipfile raise for a damaged ``.npz``, an encrypted one or one of a later format: found by fuzzing."""
HELD = (5, 32)
"""Windows' numbers of what a rename meets while a virus scanner or a viewer holds the file: access denied, sharing violation."""
WAITS_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.3)
"""Between attempts at what such a program prevents, seconds: one in all, after which it is no passing look."""
PNG, MAKE_AGAIN = b"\x89PNG\r\n\x1a\n", "run the stage that writes it again"
MOST_JSON = 1 << 21
"""Values of a JSON text. The poses and names of 20,000 photographs are a third of it."""
LONGEST_START = 100
"""Of a file's name, bytes that its temporary name begins with: file systems allow 255 in all."""


def patiently(act: Callable[..., object], *arguments: object) -> None:
    """Rename or remove something; where another program holds it for a moment (Windows), do it again for about a second.

    Raises:
        OSError: it cannot be done; or it is still held.
    """
    for wait in WAITS_S:
        try:
            act(*arguments)
            return
        except PermissionError as error:
            if getattr(error, "winerror", None) not in HELD:
                raise
        time.sleep(wait)
    act(*arguments)


def move(source: Path, target: Path) -> None:
    """Rename a file or folder, a file in the place of another one; see :func:`patiently`."""
    patiently(os.replace, source, target)


def write_atomic(path: Path, write: Callable[[BinaryIO], object], *, like: Path | None = None) -> None:
    """Write a file so that it is there whole or not at all: temporary name, fsync, rename.

    Args:
        path: where; missing folders are made.
        write: called with the open temporary file.
        like: what it is made from: who may not read that may not read this either; None = nothing that has an owner.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    start = path.name.encode(errors="surrogateescape")[:LONGEST_START].decode(errors="ignore")
    handle, partial = new_file(path.parent, f".{start}.", ".partial", mode_like(like))
    try:
        with os.fdopen(handle, "wb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        move(partial, path)
    except BaseException as error:
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)  # writing names none, and the file tells which disk is full
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def write_bytes_atomic(path: Path, content: bytes, *, like: Path | None = None) -> None:
    """Write bytes, whole or not at all; ``like``: see :func:`write_atomic`."""
    write_atomic(path, lambda stream: stream.write(content), like=like)


def full_disk(error: OSError, path: Path) -> Path | None:
    """Where there was no room, if an error in writing came from that; None where it came from something else.

    Args:
        path: where was written if the error names no file; not every library passes name and number of the system on.
    """
    places = [Path(name) for name in (error.filename, error.filename2) if isinstance(name, str)]
    where = next((p for p in places if not p.absolute().is_relative_to(path.absolute())), path)
    known = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    if known and places:
        return where
    if known or error.errno is None:
        for folder in (path, Path(tempfile.gettempdir())):
            with suppress(OSError):
                if shutil.disk_usage(folder).free < LEAST_ROOM:
                    return folder
    return path if known else None


LEAST_ROOM = 2**20
"""Bytes that are left free on a disk that is full: less than the next block of a file."""
NO_MEMORY = (
    "can't allocate memory",
    "bad_alloc",
    "Insufficient memory",
    "Unable to allocate",
    "can't start new thread",
)
"""What PyTorch, the C++ library, OpenCV, NumPy and Python's threads say for want of memory, in errors that are no MemoryError."""


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error came from want of memory; libraries raise many kinds for it."""
    if isinstance(error, MemoryError) or is_out_of_gpu_memory(error):
        return True
    if isinstance(error, OSError):
        return error.errno == errno.ENOMEM
    return isinstance(error, RuntimeError | ImportError | cv2.error) and any(w in str(error) for w in NO_MEMORY)


def is_out_of_gpu_memory(error: BaseException) -> bool:
    """Whether it was a GPU's memory that an error came from want of: PyTorch, CUDA, Triton and cuBLAS each say it their way."""
    said = str(error).lower()
    return isinstance(error, RuntimeError) and (("cuda" in said and "out of memory" in said) or "alloc_failed" in said)


def read_text(path: Path, mend: str | None = None, *, most: int = LARGEST_TEXT) -> str:
    """The text of a file of a drive: UTF-8, whatever the system's own encoding is, and line ends of any system.

    Args:
        most: bytes that such a file has at most.
    Raises:
        DriveError: it cannot be read, is larger, or is no UTF-8; with the ``mend`` that is given.
    """
    try:
        # Editors of Windows begin UTF-8 with a mark, and end its lines in their way.
        text = read_bytes(path, most).decode("utf-8-sig")
        return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    except UnicodeDecodeError as error:
        problem = f"Not UTF-8 text: {error.reason} at byte {error.start}"
        raise DriveError(problem, path=path, mend=mend or "save it as UTF-8") from error
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend=mend) from error


def parsed_json(text: str | bytes) -> Any:
    """What a JSON text holds. Whole numbers of more digits than 64 bits have become floats, as in other programs.

    Raises:
        ValueError: it is no JSON, holds more values than any file that is read, or lists lie too deep within one another.
    """
    if len(text) > MOST_JSON:  # a list of nothing takes two bytes, and a hundred in memory
        marks: Any = (b"[", b"{", b",") if isinstance(text, bytes) else ("[", "{", ",")
        parts = sum(text.count(mark) for mark in marks)
        if parts > MOST_JSON:
            raise ValueError(f"it holds {parts:,} values, of which {MOST_JSON:,} are read")
    try:
        return json.loads(text, parse_int=_whole)
    except RecursionError:
        raise ValueError("it holds too many lists or objects within one another") from None


def _whole(digits: str) -> int | float:
    return int(digits) if len(digits) < 20 else float(digits)


def read_json(path: Path) -> object:
    """What a JSON file of a drive holds.

    Raises:
        DriveError: it cannot be read, or is no JSON.
    """
    text = read_text(path)
    try:
        content: object = parsed_json(text)
    except ValueError as error:
        raise DriveError(f"Not valid JSON: {error}", path=path) from error
    return content


def read_own_json(path: Path, most: int = LARGEST_STATE) -> Any:
    """What a JSON file of a workspace holds; no link is followed.

    Args:
        most: bytes that it has at most.
    Raises:
        OSError: it is not there, is no regular file or larger, or cannot be read.
        ValueError: it is no JSON in UTF-8.
    """
    return parsed_json(read_bytes(path, most, links=False).decode("utf-8"))


def write_json_atomic(path: Path, content: object, *, like: Path | None = None) -> None:
    """Write JSON, whole or not at all; ``like``: see :func:`write_atomic`."""
    write_bytes_atomic(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode(), like=like)


def write_image_atomic(
    path: Path, image: NDArray[np.generic], *, like: Path | None = None, metadata: Metadata | None = None
) -> None:
    """Write an image in the format of its suffix: (H, W, 3) RGB, (H, W, 4) RGBA or (H, W), uint8 or uint16.

    Args:
        like: see :func:`write_atomic`.
        metadata: what the picture that it was made from means; goes into a PNG.
    """
    path = Path(path)
    order = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    ordered = cv2.cvtColor(image, order[image.shape[2]]) if image.ndim == 3 else image
    options = [cv2.IMWRITE_JPEG_QUALITY, 95] if path.suffix.lower() in (".jpg", ".jpeg") else []
    done, encoded = cv2.imencode(path.suffix, np.ascontiguousarray(ordered), options)
    if not done:
        raise ValueError(f"cannot encode {path.name}")
    content = encoded.tobytes()
    write_bytes_atomic(path, content if metadata is None else metadata.in_png(content), like=like)


def copy_picture(source: Path, destination: Path) -> None:
    """Copy a PNG of a workspace, whole or not at all; who may not read it may not read the copy either.

    Raises:
        WorkspaceError: it is no PNG, or a link: a stranger's workspace is not to bring other files to where results are taken from.
    """
    try:
        with open_file(source, links=False) as content:
            start = content.read(len(PNG))
            content.seek(0)
            if start == PNG:
                write_atomic(destination, lambda stream: shutil.copyfileobj(content, stream), like=source)
                return
    except RefusedFileError as error:
        raise WorkspaceError(f"cannot be copied: {error.strerror}", path=source, mend=MAKE_AGAIN) from error
    raise WorkspaceError("Not a PNG", path=source, mend=MAKE_AGAIN)
