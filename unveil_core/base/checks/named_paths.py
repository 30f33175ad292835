"""Files that a drive's own files name."""

from __future__ import annotations

import os
from pathlib import Path

from unveil_core.base.errors import DriveError

__all__ = ["named_path"]

LONGEST_BYTES, LONGEST_PART_BYTES = 4000, 255
"""Of a path and of the name of one file or folder in it: systems take no more."""


def named_path(folder: Path, name: object, path: Path, key: str) -> Path:
    """The file that a text means, which is relative to a folder; Windows writes backslashes.

    Args:
        path: of the file that names it, for messages; key: where that does so, likewise.
    Raises:
        DriveError: no system has files of such a name.
    """
    text = str(name).replace("\\", "/")
    try:
        raw = os.fsencode(text)
    except UnicodeEncodeError:
        raw = b"\0"
    if b"\0" in raw or len(raw) > LONGEST_BYTES or any(len(part) > LONGEST_PART_BYTES for part in raw.split(b"/")):
        raise DriveError(f"Not the name of a file: {key} is {text[:40]!r}", path=path, mend="correct it")
    return folder / text
