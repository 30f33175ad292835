"""Clean frames as plates: each as it came, OpenEXR or DPX, with other colours only where something was removed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unveil_core.base.disk.open_safely import read_bytes
from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.plates.files import read_plate
from unveil_core.base.types import Float32
from unveil_core.drives.drive import Footage

__all__ = ["plate_file", "write_clean_plate"]


def plate_file(frame: Path, footage: Footage) -> Path:
    """Where the plate of a delivered frame lies, which is itself a PNG: beside it."""
    return frame.with_name(f"{frame.stem}{footage.path.suffix.lower()}")


def write_clean_plate(footage: Footage, before: Float32, clean: Float32, path: Path) -> None:
    """Write a clean plate, of the pixel type, compression, layers and header of its footage.

    Args:
        footage: of the frame, a plate.
        before: (H, W, 3) as the scene sees it; clean: the same with what was removed filled in. Where both are equal the plate's
            own numbers stay, bit for bit.
    Raises:
        DriveError: the plate cannot be read or written.
    """
    assert footage.plate is not None
    changed = (before != clean).any(axis=2)
    if not changed.any():
        write_bytes_atomic(path, read_bytes(footage.path), like=footage.path)
        return
    plate = read_plate(footage.path)
    plate.replaced(changed, footage.plate.decoded(clean[changed].astype(np.float64))).write(path)
