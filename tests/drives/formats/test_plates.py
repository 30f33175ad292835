"""Drives whose photographs are plates: what they mean, how the scene sees them, and how they are kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.base.plates.plates import write_dpx, write_exr
from tests.drives.formats.shot.shots import COUNT, SIZE, chan
from tests.drives.formats.shot.shots import plates as write_pngs
from unveil_core.base.files import read_own_json
from unveil_core.base.pictures.decoding import read_levels
from unveil_core.base.plates.colours import PlateColours
from unveil_core.base.plates.transfers import TRANSFERS
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.registry import open_drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.drives.photographs import photograph, read_footage, seen_footage


def pictures() -> list[np.ndarray]:
    """(H, W, 3) uint8 sRGB."""
    generator = np.random.default_rng(0)
    return [generator.integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8) for _ in range(COUNT)]


def shot(folder: Path, kind: str, *, factor: float = 1.0, **header) -> Path:  # type: ignore[no-untyped-def]
    """A .chan with plates in the light of the pictures, and points."""
    (folder / "plates").mkdir(parents=True)
    for k, picture in enumerate(pictures()):
        light = (linear_of_srgb(picture / 255) * factor).astype(np.float32)
        path = folder / f"plates/a.{1001 + k}.{kind}"
        if kind == "exr":
            write_exr(path, light, **header)
        else:
            codes = np.clip(np.round(TRANSFERS["log"][1](light.astype(np.float64)) * 1023), 0, 1023).astype(np.uint16)
            write_dpx(path, codes, bits=10, transfer=header.get("transfer", "Printing density"))
    (folder / "points.csv").write_text("x,y,z\n" + "".join(f"{x},0,{-5 - x}\n" for x in range(8)))
    (folder / "shot.json").write_text(json.dumps({"units_per_metre": 1}))
    chan(folder / "cam.chan")
    return folder


@pytest.mark.parametrize("half", [True, False])
def test_linear_plates_are_seen_as_the_pictures_that_they_are(tmp_path: Path, half: bool) -> None:
    """To the last level of 8 bits, from half and float."""
    drive = open_drive(shot(tmp_path, "exr", half=half))
    assert drive.frames[0].plate == PlateColours() and "plates are EXR, linear Rec. 709" in drive.notices[-1]
    for frame, picture in zip(drive.frames, pictures(), strict=True):
        np.testing.assert_array_equal(photograph(frame), picture)


def test_logarithmic_plates(tmp_path: Path) -> None:
    drive = open_drive(shot(tmp_path, "dpx"))
    assert drive.frames[0].plate is not None and drive.frames[0].plate.transfer == "log"
    assert "DPX, log, as their header says" in drive.notices[-1]
    off = np.abs(photograph(drive.frames[0]).astype(int) - pictures()[0])
    assert np.percentile(off[pictures()[0] > 40], 99) <= 2  # a code of 10 bits is about one level there


def test_a_header_that_does_not_tell_is_told(tmp_path: Path) -> None:
    drive = open_drive(shot(tmp_path, "dpx", transfer="User defined"))
    assert "taken as log, which their header does not tell; OCIO decides" in drive.notices[-1]


def test_primaries_of_aces(tmp_path: Path) -> None:
    acescg = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    drive = open_drive(shot(tmp_path, "exr", chromaticities=acescg))
    assert "linear ACEScg" in drive.notices[-1]
    white = drive.frames[0].plate
    assert white is not None
    np.testing.assert_allclose(white.light(np.full((1, 3), 0.5)), 0.5, atol=1e-3)  # grey stays grey
    assert white.light(np.array([[0.0, 1.0, 0.0]]))[0, 0] < -0.3  # a green beyond Rec. 709


def test_a_studios_configuration_comes_before_the_header(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And is kept: what is read later does not ask the environment."""
    pytest.importorskip("PyOpenColorIO")
    monkeypatch.setenv("OCIO", "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1")
    drive = open_drive(shot(tmp_path, "exr"))
    assert "plates are EXR, ACEScg, by OCIO" in drive.notices[-1]
    monkeypatch.delenv("OCIO")
    plate = drive.frames[0].plate
    assert plate is not None and plate.transfer == "ocio"
    acescg = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    by_header = open_drive(shot(tmp_path / "b", "exr", chromaticities=acescg)).frames[0]
    off = np.abs(photograph(drive.frames[0]).astype(int) - photograph(by_header))
    assert np.percentile(off, 99) <= 1  # adapted to the white of sRGB by both


def test_what_a_compression_loses_is_not_lost_again(tmp_path: Path) -> None:
    drive = open_drive(shot(tmp_path, "exr", compression="dwaa"))
    assert "as they came, but packed without loss, beside PNGs" in drive.notices[-1]


def test_dark_and_bright_plates_are_exposed_for_the_scene(tmp_path: Path) -> None:
    dark = open_drive(shot(tmp_path / "dark", "exr", factor=1 / 64))
    assert dark.frames[0].plate is not None and dark.frames[0].plate.exposure == 64
    assert "exposed by +6 stops for the scene alone" in dark.notices[-1]
    assert np.abs(photograph(dark.frames[0]).astype(int) - pictures()[0]).max() <= 1
    bright = open_drive(shot(tmp_path / "bright", "exr", factor=2.0))
    colours = bright.frames[0].plate
    assert colours is not None and colours.exposure == 1 and colours.ceiling > 1.2
    seen = photograph(bright.frames[0])
    assert np.percentile(seen, 99) > 250 and (seen == 255).mean() < 0.02  # white is not cut off


def test_an_import_keeps_the_plates_and_what_they_mean(tmp_path: Path) -> None:
    drive = open_drive(shot(tmp_path / "shot", "exr", factor=1 / 64))
    lens = [replace(f, camera=replace(f.camera, cx=f.camera.cx + 1)) for f in drive.frames]
    imported = import_drive(replace(drive, frames=tuple(lens)), tmp_path / "drive", work_side=48)
    for frame, source in zip(imported.frames, drive.frames, strict=True):
        footage = frame.footage
        assert footage is not None and footage.path.suffix == ".exr" and footage.plate == source.plate
        assert footage.path.read_bytes() == source.image_path.read_bytes()
        np.testing.assert_array_equal(seen_footage(footage), photograph(source))
        assert read_footage(footage).dtype == np.float32 and frame.image_path.suffix == ".png"
    again = import_drive(read_imported(tmp_path / "drive"), tmp_path / "again")
    assert again.frames[0].footage is not None and again.frames[0].footage.plate == drive.frames[0].plate
    content = read_own_json(tmp_path / "drive/cameras.json")
    assert content["frames"][0]["footage"]["plate"]["exposure"] == 64


def test_plates_beside_pictures_of_eight_bits_make_the_same_drive(tmp_path: Path) -> None:
    """The working pictures are the same up to the rounding to bytes, which those of plates are spared."""
    of_plates = open_drive(shot(tmp_path / "a", "exr"))
    files = write_pngs(tmp_path / "b/plates")
    for file, picture in zip(files, pictures(), strict=True):
        cv2.imwrite(str(file), picture[..., ::-1])
    chan(tmp_path / "b/cam.chan")
    (tmp_path / "b/points.csv").write_text((tmp_path / "a/points.csv").read_text())
    (tmp_path / "b/shot.json").write_text((tmp_path / "a/shot.json").read_text())
    of_pictures = open_drive(tmp_path / "b")

    def worked(drive: Drive, name: str) -> list[np.ndarray]:
        found = import_drive(drive, tmp_path / name, work_side=60)
        return [read_levels(f.image_path) for f in found.frames]

    for one, other in zip(worked(of_plates, "one"), worked(of_pictures, "other"), strict=True):
        assert one.dtype == np.float32 and other.dtype == np.uint8
        assert np.abs(one - other).max() < 0.5 + 0.06  # and that of half floats


def test_pixels_of_plates_may_be_wide(tmp_path: Path) -> None:
    """An anamorphic plate: its header tells the lens of a .chan, unless shot.json does."""
    drive = open_drive(shot(tmp_path, "exr"))  # PixelAspectRatio 2
    assert drive.frames[0].camera.fx == pytest.approx(drive.frames[0].camera.fy / 2)
    (tmp_path / "shot.json").write_text('{"pixel_aspect": 1.0}')
    camera = open_drive(tmp_path).frames[0].camera
    assert camera.fx == pytest.approx(camera.fy)
