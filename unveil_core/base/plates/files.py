"""Plates by their files: OpenEXR or DPX, as their first bytes say."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import DriveError
from unveil_core.base.plates.dpx import dpx_facts, read_dpx
from unveil_core.base.plates.exr import exr_facts, read_exr
from unveil_core.base.plates.library import kind_of
from unveil_core.base.plates.plate import Plate, PlateFacts

__all__ = ["plate_facts", "read_plate"]


def plate_facts(path: Path) -> PlateFacts:
    """What the header of a plate tells.

    Raises:
        DriveError: missing, no plate, damaged, or the library for DPX is not installed.
    """
    return exr_facts(path) if _kind(path) == "openexr" else dpx_facts(path)


def read_plate(path: Path, size: tuple[int, int] | None = None) -> Plate:
    """Read a plate.

    Args:
        size: (width, height) that the picture must have; None = any.
    Raises:
        DriveError: see :func:`plate_facts`; or of another size, deep, or without red, green and blue.
    """
    facts = plate_facts(path)
    if size is not None and facts.size != size:
        raise DriveError(
            f"Not the size of its camera: {facts.size[0]}x{facts.size[1]} pixels, the camera says {size[0]}x{size[1]}",
            path=path,
            mend="correct w and h, or give plates of that size",
        )
    return read_exr(path) if facts.kind == "openexr" else read_dpx(path)


def _kind(path: Path) -> str:
    try:
        kind = kind_of(path)
    except FileNotFoundError as error:
        raise DriveError("Not found", path=path, mend="restore it or drop the frame") from error
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path) from error
    if kind is None:
        raise DriveError("Not an OpenEXR or DPX file", path=path, mend="export it again")
    return kind
