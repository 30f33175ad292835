"""What kind of plate a file is, and the library for DPX, an optional part: one line where it is missing."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError

__all__ = ["PLATES", "kind_of", "dpx_library"]

PLATES = (".exr", ".dpx")
"""Suffixes of plates."""
MAGIC = {b"\x76\x2f\x31\x01": "openexr", b"SDPX": "dpx", b"XPDS": "dpx"}
"""How such files begin, and what they are called here."""
NEEDS = "pip install '.[plates]' in the folder of Unveil, or convert the plates to EXR or 16-bit TIFF"


def kind_of(path: Path) -> str | None:
    """ "openexr" or "dpx" by the first bytes of a file, None of anything else.

    Raises:
        OSError: it cannot be read.
    """
    with open_file(path) as stream:
        return MAGIC.get(stream.read(4))


def dpx_library(path: Path) -> Any:
    """OpenImageIO.

    Args:
        path: of the file that needs it, for the message.
    Raises:
        DriveError: it is not installed.
    """
    if find_spec("OpenImageIO") is None:
        raise DriveError("Not installed: OpenImageIO, which reads DPX files", path=path, mend=NEEDS)
    import OpenImageIO

    return OpenImageIO
