"""Text models as people and programs write them: without lines of observations, with empty lines, without tracks."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.drives.captures import STEP_M, write_model, write_pictures
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.formats.colmap.model import read_images, read_model_points

NAMES = [f"{i:03d}.png" for i in range(9)]


def model(root: Path, count: int = 9, **how: object) -> Path:
    write_pictures(root / "images", NAMES[:count])
    write_model(root / "sparse/0", [(n, STEP_M * i) for i, n in enumerate(NAMES[:count])], **how)  # type: ignore[arg-type]
    return root / "sparse/0/images.txt"


@pytest.mark.parametrize("count", [8, 9])
def test_lines_of_observations_may_be_missing(count: int, tmp_path: Path) -> None:
    """Of an even and an odd number: every second line would be taken for observations."""
    model(tmp_path, count, observations=False)
    drive = open_drive(tmp_path)
    assert [f.name for f in drive.frames] == [n[:3] for n in NAMES[:count]] and drive.notices == ()


CHANGES = {
    "an empty line before the first": lambda t: t.replace("image:\n", "image:\n\n"),
    "empty lines everywhere": lambda t: t.replace("\n", "\n\n\n"),
    "empty lines of observations": lambda t: t.replace("1.5 2.5 1 3.5 4.5 -1", ""),
    "observations of whole pixels": lambda t: t.replace("1.5 2.5 1 3.5 4.5 -1", "1 2 1 3 4 -1 5 6 7 8 9 10"),
    "comments between": lambda t: t.replace("1.5 2.5 1 3.5 4.5 -1\n", "1.5 2.5 1 3.5 4.5 -1\n  # next\n"),
    "some lines missing": lambda t: t.replace("1.5 2.5 1 3.5 4.5 -1\n", "", 4),
    "written on Windows": lambda t: t.replace("\n", "\r\n"),
    "words in the place of observations": lambda t: t.replace("1.5 2.5 1 3.5 4.5 -1", "none"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_each_image_is_read_once(name: str, tmp_path: Path) -> None:
    path = model(tmp_path)
    path.write_bytes(CHANGES[name](path.read_text()).encode())
    assert [i.name for i in read_images(path.parent)] == NAMES


@pytest.mark.parametrize("names", [["0001", "0002"], ["a b 1", "a b 2"], ["1.5", "2.5"]])
def test_names_may_be_numbers_or_have_spaces(names: list[str], tmp_path: Path) -> None:
    for observations in (True, False):
        folder = write_model(
            tmp_path / str(observations), [(n, 1.0 * i) for i, n in enumerate(names)], observations=observations
        )
        assert [i.name for i in read_images(folder)] == names


@pytest.mark.parametrize("instead", ["", "# not this one"])
def test_an_image_s_line_may_be_taken_out_without_its_observations(instead: str, tmp_path: Path) -> None:
    path = model(tmp_path)
    lines = path.read_text().splitlines()
    lines[1] = lines[7] = instead
    path.write_text("\n".join(lines))
    assert [i.name for i in read_images(path.parent)] == [n for k, n in enumerate(NAMES) if k not in (0, 3)]


def test_a_damaged_line_is_not_taken_for_observations(tmp_path: Path) -> None:
    path = model(tmp_path, observations=False)
    lines = path.read_text().splitlines()
    lines[4] = lines[4].replace(lines[4].split()[3], "x")
    path.write_text("\n".join(lines))
    with pytest.raises(DriveError, match=r"images.txt: line 5: expected numbers for qw qx qy qz tx ty tz"):
        open_drive(tmp_path)


def test_points_without_tracks_were_measured(tmp_path: Path) -> None:
    model(tmp_path, tracks=0)
    points = open_drive(tmp_path).points
    assert len(points.positions) == 500 and points.measured


def test_points_that_two_images_see_do_not_count_and_the_line_says_how_many_there_are(tmp_path: Path) -> None:
    model(tmp_path, tracks=2)
    with pytest.raises(DriveError, match="holds 500 points, none of them seen by three images .run the mapper"):
        open_drive(tmp_path)
    path = tmp_path / "sparse/0/points3D.txt"
    path.write_text(path.read_text().replace("9 9 9 0.5 1 0 1 0", "9 9 9 7.5 1 0 1 0 1 0"))
    with pytest.raises(
        DriveError, match="500 points, 500 of them seen by three images, and none of these right to 4 pixels"
    ):
        open_drive(tmp_path)
    path.write_text("# none\n")
    with pytest.raises(DriveError, match="holds no points .export the model with its points"):
        open_drive(tmp_path)


def test_measured_points_do_not_hide_the_others(tmp_path: Path) -> None:
    model(tmp_path)
    path = tmp_path / "sparse/0/points3D.txt"
    path.write_text(path.read_text() + "9001 1.0 2.0 0.0 9 9 9 0\n9002 1.0 nan 0.0 9 9 9 0\n")
    points = read_model_points(path.parent)
    assert len(points.positions) == 501 and not points.measured
