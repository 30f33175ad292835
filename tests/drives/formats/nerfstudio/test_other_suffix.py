"""A picture is of the format that it is of, whatever its name ends in."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive


@pytest.mark.parametrize("suffix", [".webp", ".bmp", ".tiff", ".jpg"])
@pytest.mark.parametrize("sizes", ["told", "left out"])
def test_called_png_it_opens_and_is_imported(suffix: str, sizes: str, tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path / "drive")
    for picture in (tmp_path / "drive/images").iterdir():
        smooth = cv2.GaussianBlur(cv2.imread(str(picture)), (9, 9), 3)
        picture.write_bytes(cv2.imencode(suffix, smooth)[1].tobytes())
    if sizes == "left out":
        edit(path, lambda d: [d.pop("w"), d.pop("h")])
    drive = open_drive(path)
    assert {(f.camera.width, f.camera.height) for f in drive.frames} == {(32, 24)}
    check_drive(drive)
    imported = import_drive(drive, tmp_path / "imported", work_side=None)
    shown = [cv2.imread(str(f.image_path)) for f in imported.frames]
    assert all(s.shape == (24, 32, 3) and np.ptp(s) > 20 for s in shown)
