"""Files that a drive names otherwise than they lie there are found; what is missing is counted and named."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.drives.captures import STEP_M, frame, frames, move, way, write_model, write_pictures, write_transforms
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.formats.on_disk.pictures import NamedFiles, pictures_below, pictures_in
from unveil_core.drives.importing.check import check_drive

NAMES = [f"{i:03d}.png" for i in range(8)]
TRUE_M = STEP_M * 7


@pytest.mark.parametrize(
    ("named", "there", "told"),
    [
        ("images/{}.png", "images/{}.png", None),
        ("images/{}.jpg", "images/{}.JPG", None),
        ("images/{}.JPG", "images/{}.jpg", None),
        ("images/{}", "images/{}.JPEG", None),
        ("images/{}", "images/{}.webp", None),
        ("./images/{}", "images/{}.png", None),
        (r".\images\{}.png", "images/{}.png", None),
        (r"C:\Users\me\capture\images\{}.png", "images/{}.png", "those in images/ are taken"),
        ("/home/me/capture/images/{}.png", "images/{}.png", "those in images/ are taken"),
        ("file:///home/me/capture/images/{}.png", "images/{}.png", "those in images/ are taken"),
        ("data/nerf/fox/images/{}.png", "images/{}.png", "those in images/ are taken"),
        (r"D:\x\{}.png", "{}.png", "are taken"),
        ("{}.png", "images/{}.png", "those in images/ are taken"),
        ("images/{}.png", "Images/{}.PNG", "those in Images/ are taken"),
        ("rgb/{}.png", "images/{}.png", "those in images/ are taken"),
        ("images/{}.jpg", "images/{}.png", "8 pictures have another suffix than their names: 000.png is taken for images/000.jpg"),
    ],
)  # fmt: skip
def test_pictures_are_found_under_the_names_that_tools_write(
    named: str, there: str, told: str | None, tmp_path: Path
) -> None:
    stems = [f"{i:03d}" for i in range(8)]
    entries = frames([named.format(s) for s in stems])
    drive = open_drive(write_transforms(tmp_path, entries, pictures=[there.format(s) for s in stems]))
    assert [f.image_path for f in drive.frames] == [tmp_path / there.format(s) for s in stems]
    assert [f.name for f in drive.frames] == stems and list(way(drive)) == ["camera"]
    assert len(drive.notices) == (told is not None) and (told is None or told in drive.notices[0])
    check_drive(drive)


def test_other_files_are_found_too(tmp_path: Path) -> None:
    """Masks, labels and points of another machine, and in capitals."""
    entries = frames([f"images/{n}" for n in NAMES], mask_path=[rf"E:\old\masks\{n}" for n in NAMES])
    path = write_transforms(tmp_path, entries, ply_file_path=r"E:\old\Points.ply")
    write_pictures(tmp_path / "masks", [n.replace(".png", ".PNG") for n in NAMES])
    move(tmp_path / "points.ply", tmp_path / "POINTS.PLY")
    drive = open_drive(path)
    assert [f.mask_path for f in drive.frames] == [tmp_path / "masks" / n.replace(".png", ".PNG") for n in NAMES]
    assert len(drive.points.positions) == 500


def test_deleted_pictures_are_counted_named_and_left_out(tmp_path: Path) -> None:
    left = [f"images/{NAMES[i]}" for i in (0, 2, 6)]
    drive = open_drive(write_transforms(tmp_path, frames([f"images/{n}" for n in NAMES]), pictures=left))
    assert [f.image_path for f in drive.frames] == [tmp_path / p for p in left]
    assert drive.notices == (
        "5 of 8 photographs are not there and are left out: images/001.png, images/003.png, images/004.png and 2 more",
    )
    check_drive(drive)


def test_a_deleted_picture_is_not_looked_for_in_another_camera_s_folder(tmp_path: Path) -> None:
    sides = (("left", -0.3), ("images", 0.3))
    entries = [
        frame(f"{c}/{n}", STEP_M * i, mount={"offset": (o, 0.0, 0.0)}, camera=c)
        for c, o in sides
        for i, n in enumerate(NAMES)
    ]
    pictures = [e["file_path"] for e in entries if e["file_path"] != "left/003.png"]
    drive = open_drive(write_transforms(tmp_path, entries, pictures=pictures))
    assert (
        len(drive.frames) == 15 and "1 of 16 photographs are not there and are left out: left/003.png" in drive.notices
    )


def test_two_named_folders_are_never_one(tmp_path: Path) -> None:
    """Of a rig of another machine of which one camera's pictures are here, under the usual name."""
    entries = [
        frame(rf"D:\c\{c}\{n}", STEP_M * i, mount={"offset": (o, 0.0, 0.0)})
        for c, o in (("left", -0.3), ("right", 0.3))
        for i, n in enumerate(NAMES)
    ]
    drive = open_drive(write_transforms(tmp_path, entries, pictures=[f"images/{n}" for n in NAMES]))
    assert len({f.image_path for f in drive.frames}) == len(drive.frames) == 8
    assert any("8 of 16 photographs are not there" in n for n in drive.notices)


@pytest.mark.parametrize(
    ("there", "line"),
    [
        (
            ["images/a.png", "images/b.png"],
            r"the first images/000.png .images/ holds 2 pictures of other names, as a.png",
        ),
        (["a.png"], r"the first images/000.png .*/ holds one picture, a.png"),
        ([], "the first images/000.png .no pictures lie beside it: restore them, or correct file_path"),
    ],
)
def test_where_no_picture_is_there_the_line_says_what_lies_there(there: list[str], line: str, tmp_path: Path) -> None:
    path = write_transforms(tmp_path, frames([f"images/{n}" for n in NAMES]), pictures=there)
    with pytest.raises(DriveError, match=f"none of the 8 photographs is there, {line}"):
        open_drive(path)


def test_two_pictures_of_another_suffix_are_not_guessed_from(tmp_path: Path) -> None:
    there = [f"images/{i:03d}{s}" for i in range(8) for s in (".png", ".webp")]
    path = write_transforms(tmp_path, frames([f"images/{i:03d}.jpg" for i in range(8)]), pictures=there)
    with pytest.raises(DriveError, match="none of the 8 photographs is there"):
        open_drive(path)


@pytest.mark.parametrize("name", ["{}.PNG", r"C:\cap\images\{}.png", "/srv/cap/images/{}.png", r"x\{}.png"])
def test_colmap_s_names_are_found_likewise(name: str, tmp_path: Path) -> None:
    stems = [f"{i:03d}" for i in range(8)]
    write_pictures(tmp_path / "images", [("x/" if name[:2] == "x\\" else "") + f"{s}.png" for s in stems])
    write_model(tmp_path / "sparse/0", [(name.format(s), STEP_M * i) for i, s in enumerate(stems)])
    drive = open_drive(tmp_path)
    assert [f.name for f in drive.frames] == stems and all(f.image_path.is_file() for f in drive.frames)
    assert list(way(drive).values()) == pytest.approx([TRUE_M], rel=1e-3)


def test_colmap_goes_on_without_deleted_pictures_and_tells_those_it_has_no_pose_of(tmp_path: Path) -> None:
    write_pictures(tmp_path / "images", [*NAMES[:5], "100.png"])
    write_model(tmp_path / "sparse/0", [(n, STEP_M * i) for i, n in enumerate(NAMES)])
    drive = open_drive(tmp_path)
    assert [f.name for f in drive.frames] == [n[:3] for n in NAMES[:5]]
    assert drive.notices == (
        "3 of 8 photographs are not there and are left out: 005.png, 006.png, 007.png",
        "images/ holds 6 pictures, the model has poses of 5 of them: 1 are not read, the first 100.png",
    )


def test_colmap_s_pictures_may_lie_in_input(tmp_path: Path) -> None:
    write_pictures(tmp_path / "input", NAMES)
    write_model(tmp_path / "sparse/0", [(n, STEP_M * i) for i, n in enumerate(NAMES)])
    drive = open_drive(tmp_path)
    assert len(drive.frames) == 8 and drive.notices == ("no folder images/: pictures come from input/",)


def test_pictures_that_no_frame_names_are_counted(tmp_path: Path) -> None:
    pictures = [f"images/{n}" for n in NAMES]
    path = write_transforms(tmp_path, frames(pictures)[:6], pictures=[*pictures, "images/notes.webp"])
    assert open_drive(path).notices == (
        "images/ holds 8 pictures, the file names 6 of them: 2 are not read, the first 006.png",
    )


def test_links_that_lead_nowhere_are_missing_and_folders_are_no_pictures(tmp_path: Path) -> None:
    write_pictures(tmp_path, ["10.png", "9.PNG", "sub/1.jpg", ".hidden.png"])
    (tmp_path / "8.png").mkdir()
    (tmp_path / "7.png").symlink_to(tmp_path / "nowhere")
    assert pictures_in(tmp_path) == ["9.PNG", "10.png"]
    (tmp_path / "7.png").unlink()
    assert pictures_below(tmp_path) == ["9.PNG", "10.png", "sub/1.jpg"]
    (tmp_path / "7.png").symlink_to(tmp_path / "nowhere")
    named = NamedFiles(tmp_path / "transforms.json")
    found = named.pictures(["8.png", "7.png", "10.png", "9.png"], "file_path")
    assert found == [None, None, tmp_path / "10.png", tmp_path / "9.PNG"]


def test_a_picture_that_is_named_as_it_lies_is_that_of_no_other_name(tmp_path: Path) -> None:
    """A deleted ``0.jpg`` beside ``0.png``."""
    write_pictures(tmp_path, ["0.png", "1.png"])
    assert NamedFiles(tmp_path / "t.json").pictures(["0.jpg", "0.png", "1.jpg"], "file_path") == [
        None, tmp_path / "0.png", tmp_path / "1.png",
    ]  # fmt: skip
