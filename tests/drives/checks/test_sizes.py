"""Pictures that were reduced and calibrations that were not: scaled where the ratio is clean, and told."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.checks.lenses import lens_findings
from unveil_core.drives.checks.sizes import calibration_size
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.check import check_drive

IN_TABLES = "Waymo Open v2"
"""Its photographs are in tables."""
ALL = DriveOptions(cameras=("all",))


def resized(drive: Drive, times: float) -> None:
    """All pictures of a drive at another size, its calibration as it was."""
    for frame in drive.frames:
        for path, way in (
            (frame.image_path, cv2.INTER_AREA),
            (frame.semantic_path, cv2.INTER_NEAREST),
            (frame.instance_path, cv2.INTER_NEAREST),
            (frame.mask_path, cv2.INTER_NEAREST),
        ):
            if path is not None:
                picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
                cv2.imwrite(str(path), cv2.resize(picture, None, fx=times, fy=times, interpolation=way))


@pytest.mark.parametrize("times", [0.5, 2.0])
@pytest.mark.parametrize("name", [n for n in WRITERS if n != IN_TABLES])
def test_each_reader_scales_the_calibration_to_the_pictures(name: str, times: float, tmp_path: Path) -> None:
    path = WRITERS[name](tmp_path, tiny_street())
    before = open_drive(path, ALL)
    assert not any("it is scaled by" in n for n in before.notices)
    resized(before, times)
    after = open_drive(path, ALL)
    assert sum(f"it is scaled by {times:g}" in n for n in after.notices) == len({f.camera_name for f in after.frames})
    for one, two in zip(before.frames, after.frames, strict=True):
        assert two.camera.intrinsics == pytest.approx([times * v for v in one.camera.intrinsics])
        assert (two.camera.world_to_camera == one.camera.world_to_camera).all()
    check_drive(after)
    assert lens_findings(after) == []


@pytest.mark.parametrize(
    ("picture", "centre", "size"),
    [
        ((1920, 1080), (970.0, 483.3), (1920, 1080)),  # PandaSet as released
        ((960, 540), (970.0, 483.3), (1920, 1080)),
        ((1536, 864), (970.0, 483.3), (1920, 1080)),  # by 0.8, which only a known size tells
        ((480, 320), (951.2, 635.4), (1920, 1280)),  # Waymo
        ((621, 188), (607.2, 185.2), (1242, 375)),  # KITTI: the half of 187.5 is rounded
        ((640, 360), (320.0, 180.0), (640, 360)),
        ((640, 360), (340.0, 170.0), (640, 360)),  # a lens may be off by so much
        ((1000, 600), (900.0, 350.0), (1000, 600)),  # cropped at the left: told, not scaled
        ((500, 300), (990.0, 610.0), (2000, 1200)),
        ((3000, 2000), (500.0, 333.0), (1000, 667)),
        ((640, 360), (float("nan"), 180.0), (640, 360)),
    ],
)
def test_the_size_of_a_calibration_follows_from_its_principal_point(
    picture: tuple[int, int], centre: tuple[float, float], size: tuple[int, int]
) -> None:
    assert calibration_size(picture, centre) == size


def test_a_file_without_w_and_h_is_understood_by_cx_and_cy(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    resized(open_drive(drive), 2.0)
    edit(drive, lambda d: [d.pop(k) for k in ("w", "h")])
    opened = open_drive(drive)
    camera = opened.frames[0].camera
    assert camera.intrinsics == (64, 48, 50.0, 52.0, 32.0, 24.0)
    assert any("pictures are 64x48, their calibration is of 32x24" in n for n in opened.notices)


def test_other_sizes_are_one_line(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    path = tmp_path / "images/00.png"
    cv2.imwrite(str(path), np.zeros((20, 32, 3), np.uint8))
    with pytest.raises(
        DriveError, match=r"00\.png: Not the size of its camera: 32x20 pixels, the camera says 32x24 \(resize the image"
    ):
        check_drive(open_drive(drive))


def test_swapped_sides_are_told_with_what_turns_them(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    edit(drive, lambda d: d.update(w=24, h=32, cx=12.0, cy=16.0))
    with pytest.raises(
        DriveError,
        match=r"Not the size of its camera: 32x24 pixels, the camera says 24x32 \(width and height are swapped",
    ):
        check_drive(open_drive(drive))
    done, plain = cv2.imencode(".jpg", cv2.imread(str(tmp_path / "images/00.png")))
    tiff = b"II*\0\x08\0\0\0" + b"\x01\0" + b"\x12\x01\x03\0\x01\0\0\0\x06\0\0\0" + bytes(4)
    exif = b"Exif\0\0" + tiff
    held = plain.tobytes()[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + plain.tobytes()[2:]
    (tmp_path / "images/00.jpg").write_bytes(held)
    edit(drive, lambda d: d["frames"][0].update(file_path="images/00.jpg"))
    with pytest.raises(
        DriveError,
        match=r"Stored with 32x24 pixels, and only EXIF turns it to the 24x32 of its camera \(6\)",
    ):
        check_drive(open_drive(drive))
