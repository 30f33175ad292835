"""Of several models the largest is read, or that which is asked for, or those that share pictures, joined."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.drives.captures import STEP_M, way, write_model, write_pictures, write_transforms
from tests.drives.captures import frames as entries
from unveil_core.app.cli import main
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.drives import open_drive
from unveil_core.drives.imported import read_imported

NAMES = [f"{i:03d}.png" for i in range(12)]
TURN = np.array([[np.cos(0.7), -np.sin(0.7), 0.0], [np.sin(0.7), np.cos(0.7), 0.0], [0.0, 0.0, 1.0]])
ELSEWHERE = (2.5, TURN, np.array([5.0, -3.0, 2.0]))


def images(first: int, last: int) -> list[tuple[str, float]]:
    return [(NAMES[i], STEP_M * i) for i in range(first, last)]


def three(root: Path) -> Path:
    """Models of 3, 7 and 6 pictures: the second and third share three, the first and second one."""
    write_pictures(root / "images", NAMES)
    write_model(root / "sparse/0", images(0, 3))
    write_model(root / "sparse/1", images(2, 9))
    write_model(root / "sparse/2", images(6, 12), place=ELSEWHERE)
    return root


def stems(root: Path, model: str | None = None) -> list[str]:
    return [f.name for f in open_drive(root, DriveOptions(model=model)).frames]


def test_the_largest_is_taken_and_the_others_are_told(tmp_path: Path) -> None:
    drive = open_drive(three(tmp_path))
    assert [f.name for f in drive.frames] == [n[:3] for n in NAMES[2:9]]
    assert drive.notices == (
        "found 3 models, 0 (3 pictures), 1 (7 pictures), 2 (6 pictures): 1 is taken, without 5 pictures that only others have; "
        "--model N decides; --model 1,2 joins those that share pictures",
        "images/ holds 12 pictures, the model has poses of 7 of them: 5 are not read, the first 000.png",
    )


@pytest.mark.parametrize(("model", "first", "last"), [("0", 0, 3), ("1", 2, 9), ("2", 6, 12)])
def test_the_model_that_is_asked_for_is_read(model: str, first: int, last: int, tmp_path: Path) -> None:
    assert stems(three(tmp_path), model) == [n[:3] for n in NAMES[first:last]]


@pytest.mark.parametrize("model", ["1,2", "2,1", "all", "1, 2"])
def test_models_that_share_pictures_are_joined(model: str, tmp_path: Path) -> None:
    three(tmp_path)
    drive = open_drive(tmp_path, DriveOptions(model=model))
    scale = 2.5 if model == "2,1" else 1.0
    assert [f.name for f in drive.frames] == [n[:3] for n in NAMES[2:]]
    assert list(way(drive).values()) == pytest.approx([9 * STEP_M * scale], rel=1e-3)
    assert "is joined with model" in drive.notices[0] and "by 3 pictures that both have" in drive.notices[0]
    # The points of both are those of one street.
    half = len(drive.points.positions) // 2
    np.testing.assert_allclose(drive.points.positions[:half], drive.points.positions[half:], atol=1e-9)
    headings = [f.camera.forward for f in drive.frames]
    assert min(float(a @ b) for a, b in zip(headings[:-1], headings[1:], strict=True)) > 0.999
    assert ("models that share too few pictures with the others are left out: 0" in drive.notices) == (model == "all")


def test_models_are_joined_through_each_other(tmp_path: Path) -> None:
    write_pictures(tmp_path / "images", NAMES)
    write_model(tmp_path / "sparse/0", images(0, 5))
    write_model(tmp_path / "sparse/1", images(7, 12), place=ELSEWHERE)
    write_model(tmp_path / "sparse/2", images(3, 9), place=(0.5, TURN.T, np.zeros(3)))
    assert stems(tmp_path, "0,1,2") == [n[:3] for n in NAMES]
    assert list(way(open_drive(tmp_path, DriveOptions(model="0,1,2"))).values()) == pytest.approx([13.2], rel=1e-3)


def test_the_largest_is_that_with_most_pictures_that_are_there(tmp_path: Path) -> None:
    three(tmp_path)
    for name in NAMES[2:8]:
        (tmp_path / "images" / name).unlink()
    drive = open_drive(tmp_path)
    assert [f.name for f in drive.frames] == [n[:3] for n in NAMES[8:]]
    assert "2 of 6 photographs are not there and are left out: 006.png, 007.png" in drive.notices


def test_the_first_of_equal_ones_is_taken(tmp_path: Path) -> None:
    write_pictures(tmp_path / "images", NAMES)
    for k in (10, 2):
        write_model(tmp_path / f"sparse/{k}", images(k, k + 2) if k == 2 else images(0, 2))
    assert stems(tmp_path) == ["002", "003"]


@pytest.mark.parametrize(
    ("model", "line"),
    [
        ("7", r"has no model 7 .it has 0 .3 pictures., 1 .7 pictures., 2 .6 pictures.."),
        ("0,2", "model 2 of .* shares fewer than 2 pictures with model 0"),
        ("", "Not a model"),
        ("1,,2", "Not a model"),
    ],
)
def test_a_model_that_there_is_none_of_is_one_line(model: str, line: str, tmp_path: Path) -> None:
    three(tmp_path)
    with pytest.raises(SettingsError, match=line):
        open_drive(tmp_path, DriveOptions(model=model))


def test_a_damaged_model_beside_a_good_one_is_left_out_and_told(tmp_path: Path) -> None:
    three(tmp_path)
    (tmp_path / "sparse/1/images.txt").write_text("1 0 0 0 0 0 0 0 1 a.png\n")
    drive = open_drive(tmp_path)
    assert len(drive.frames) == 6 and "model 1 is left out: " in drive.notices[0]
    with pytest.raises(DriveError, match="Not a rotation"):
        open_drive(tmp_path, DriveOptions(model="1"))


def test_the_largest_that_is_whole_is_taken(tmp_path: Path) -> None:
    three(tmp_path)
    (tmp_path / "sparse/1/points3D.txt").unlink()
    drive = open_drive(tmp_path)
    assert len(drive.frames) == 6 and "model 1 is left out: " in drive.notices[0] and "points3D" in drive.notices[0]


def test_a_folder_of_models_and_a_model_itself_are_drives(tmp_path: Path) -> None:
    three(tmp_path)
    assert len(open_drive(tmp_path / "sparse").frames) == 7
    assert len(open_drive(tmp_path / "sparse/2").frames) == 6


def test_other_drives_have_no_models(tmp_path: Path) -> None:
    path = write_transforms(tmp_path, entries([f"images/{n}" for n in NAMES]))
    with pytest.raises(
        SettingsError, match="a drive of transforms.json has no models to choose from .leave --model out"
    ):
        open_drive(path, DriveOptions(model="1"))


def test_points_beside_a_transforms_json_are_those_of_its_pictures(tmp_path: Path) -> None:
    three(tmp_path)
    path = write_transforms(
        tmp_path, entries([f"images/{n}" for n in NAMES])[6:], ply_file_path=None, applied_transform=None
    )
    (tmp_path / "sparse/2/points3D.txt").write_text("1 30.0 30.0 0.0 9 9 9 0.5 1 0 1 0 1 0\n")
    drive = open_drive(path)
    assert len(drive.points.positions) == 1
    assert "points are those of sparse/2, of 3 COLMAP models; ply_file_path decides" in "; ".join(drive.notices)


def test_the_command_takes_the_model_and_records_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    three(tmp_path / "capture")
    arguments = ["import", str(tmp_path / "capture"), "-o", str(tmp_path / "ws"), "--scale", "1"]
    assert main([*arguments, "--model", "0"]) == 0
    assert len(read_imported(tmp_path / "ws/drive").frames) == 3
    capsys.readouterr()
    assert main(["status", str(tmp_path / "ws")]) == 0
    assert "import       done" in capsys.readouterr().out
    assert main(arguments[:3] + arguments[3:] + ["--model", "auto"]) == 0
    assert len(read_imported(tmp_path / "ws/drive").frames) == 7
