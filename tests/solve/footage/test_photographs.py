"""Folders of photographs: their order, how they are held, what they note."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_image
from unveil_core.solve.footage.kinds import camera_names, is_footage, pictures_in
from unveil_core.solve.footage.photographs import take_photographs


def _photograph(path: Path, size: tuple[int, int] = (40, 30), **tags: object) -> None:
    """A JPEG that is red at its left end; tags by name."""
    picture = np.full((size[1], size[0], 3), 60, np.uint8)
    picture[:, : size[0] // 2] = (220, 40, 40)
    exif = Image.Exif()
    if "orientation" in tags:
        exif[274] = tags["orientation"]
    own = exif.get_ifd(0x8769)
    if "focal" in tags:
        own[41989] = tags["focal"]
    if "taken" in tags:
        own[36867] = tags["taken"]
    if "place" in tags:
        gps = exif.get_ifd(0x8825)
        north, east = tags["place"]  # type: ignore[misc]
        gps[1], gps[2], gps[3], gps[4] = "N", (north, 0.0, 0.0), "E", (east, 0.0, 0.0)
    Image.fromarray(picture).save(path, quality=95, exif=exif)


def test_photographs_are_taken_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    for k in (10, 9, 1):
        _photograph(source / f"IMG_{k}.jpg")
    (source / "notes.txt").write_text("mine")
    reel = take_photographs(source, tmp_path / "images", "camera", None, 1, "")
    assert [f.name for f in reel.frames] == ["IMG_1", "IMG_9", "IMG_10"]
    assert (tmp_path / "images/IMG_9.jpg").read_bytes() == (source / "IMG_9.jpg").read_bytes()
    assert [f.number for f in take_photographs(source, tmp_path / "b", "camera", "1:", 1, "").frames] == [1, 2]


def test_a_photograph_that_is_held_upright_is_written_upright(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    _photograph(source / "a.jpg", orientation=6)  # to be turned clockwise: its left end comes up
    reel = take_photographs(source, tmp_path / "images", "camera", None, 1, "")
    found = read_image(tmp_path / "images" / reel.frames[0].file)
    assert reel.size == (30, 40) and found.shape == (40, 30, 3)
    assert found[5, 15, 0] > 180 and found[35, 15, 0] < 90


def test_focal_length_place_and_time_are_read(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    for k in range(3):
        _photograph(source / f"{k}.jpg", focal=26, place=(52.5, 13.25 + k), taken=f"2026:11:28 10:00:0{k}")
    reel = take_photographs(source, tmp_path / "images", "camera", None, 1, "")
    assert reel.focal_px == pytest.approx(26 / 43.27 * 50)  # the diagonal of 40 x 30
    assert "EXIF, 26 mm" in reel.focal_source
    assert (reel.frames[1].latitude, reel.frames[1].longitude) == (52.5, 14.25)
    times = [f.time_s for f in reel.frames]
    assert times[0] is not None and times[2] == times[0] + 2


def test_times_that_do_not_rise_are_not_believed(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    for k in range(3):
        _photograph(source / f"{k}.jpg", taken="2026:11:28 10:00:00")
    assert {f.time_s for f in take_photographs(source, tmp_path / "images", "c", None, 1, "").frames} == {None}


def test_two_sizes_are_refused_with_the_picture(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    _photograph(source / "a.jpg")
    _photograph(source / "b.jpg", size=(50, 30))
    with pytest.raises(DriveError, match=r"Two sizes of pictures: 40x30 and, at b\.jpg, 50x30 .*a folder of its own"):
        take_photographs(source, tmp_path / "images", "camera", None, 1, "")


def test_what_footage_is(tmp_path: Path) -> None:
    for name in ("a.MP4", "b.txt"):
        (tmp_path / name).write_bytes(b"")
    assert is_footage(tmp_path / "a.MP4") and not is_footage(tmp_path / "b.txt") and not is_footage(tmp_path)
    for k in range(2):
        _photograph(tmp_path / f"{k}.jpg")
    assert is_footage(tmp_path) and len(pictures_in(tmp_path)) == 2
    assert camera_names([tmp_path]) == ["camera"]
    assert camera_names([tmp_path / "left.mp4", tmp_path / "right eye"]) == ["left", "right_eye"]
    with pytest.raises(DriveError, match="Two cameras are called a"):
        camera_names([Path("x/a"), Path("y/a")])
