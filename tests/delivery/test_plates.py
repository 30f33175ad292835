"""Clean plates: composed in light, written as they came, and as good as those of the same pictures with 8 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.base.plates.plates import attributes, pixels, write_exr
from tests.delivery.test_full_size import CAMERA, delivered, masks, texture
from unveil_core.base.plates.colours import PlateColours
from unveil_core.base.plates.files import read_plate
from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.delivery.plates import plate_file, write_clean_plate
from unveil_core.drives.drive import Footage
from unveil_core.drives.importing.frames import at_work_size, working_camera
from unveil_core.drives.photographs import read_footage


@pytest.mark.parametrize("half", [True, False])
def test_a_clean_plate_beside_that_of_eight_bits(tmp_path: Path, half: bool) -> None:
    """Untouched pixels are the file's, bit for bit; the others within half a code value of the 8-bit frame."""
    eight = (texture() * 255).astype(np.uint8)
    path = write_exr(tmp_path / "f.1001.exr", linear_of_srgb(eight / 255).astype(np.float32), half=half)
    removed, relit = masks()
    camera = working_camera(CAMERA, 90)
    clean = at_work_size(eight, Footage(path, CAMERA), camera)
    clean[removed | relit] = 255 - clean[removed | relit]
    footage = Footage(path, CAMERA, plate=PlateColours())
    before = read_footage(footage)
    of_eight = delivered(eight, removed, relit, clean)
    of_plate = delivered(before, removed, relit, clean, plate=PlateColours())
    file = plate_file(tmp_path / "out/f.1001.png", footage)
    assert file == tmp_path / "out/f.1001.exr"
    write_clean_plate(footage, before, of_plate, file)
    own, made = pixels(path), pixels(file)
    touched = (of_plate != before).any(axis=2)
    assert 0.02 < touched.mean() < 0.3
    np.testing.assert_array_equal(made[~touched].view(np.uint32), own[~touched].view(np.uint32))
    np.testing.assert_array_equal(made[..., 4:], own[..., 4:])
    levels = srgb_of_linear(np.clip(made[..., :3], 0, 1)) * 255
    apart = np.abs(levels - of_eight)
    assert apart[touched].max() < 0.5 + 0.06  # rounding of 8 bits, and of half
    assert attributes(file) == attributes(path)


def test_what_shines_stays(tmp_path: Path) -> None:
    """Plates far above white: untouched to the bit, and what is filled in may shine, too."""
    light = (texture() * 4).astype(np.float32)
    light[:30, :, :] = 12.0
    path = write_exr(tmp_path / "f.exr", light, half=False)
    colours = PlateColours(ceiling=float(srgb_of_linear(np.array(12.0))))
    footage = Footage(path, CAMERA, plate=colours)
    before = read_footage(footage)
    clean = before.copy()
    clean[10:20, 10:40] = 1.0
    clean[60:70, 10:40] = 0.9
    write_clean_plate(footage, before, clean, tmp_path / "c.exr")
    made = read_plate(tmp_path / "c.exr").values
    np.testing.assert_allclose(made[10:20, 10:40], 12.0, rtol=1e-4)
    assert 1 < made[65, 20, 0] < 12
    changed = (clean != before).any(axis=2)
    np.testing.assert_array_equal(made[~changed], light[~changed])


def test_a_frame_without_anything_removed_is_the_file_itself(tmp_path: Path) -> None:
    path = write_exr(tmp_path / "f.exr", texture().astype(np.float32), compression="dwaa")
    footage = Footage(path, CAMERA, plate=PlateColours())
    before = read_footage(footage)
    write_clean_plate(footage, before, before, tmp_path / "c.exr")
    assert (tmp_path / "c.exr").read_bytes() == path.read_bytes()
