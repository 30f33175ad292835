"""Label pictures of a folder take the place of a drive's own, frame by frame."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from tests.drives.captures import frames, write_picture, write_transforms
from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.labels.reading import instances_of, semantics_of
from unveil_core.pipeline.settings import RunSettings


def labelled(folder: Path, drive: Path, *, by_camera: bool) -> Path:
    """A folder of labels for the drive, another class in each frame."""
    for i, frame in enumerate(open_drive(drive).frames):
        picture = np.full((frame.camera.height, frame.camera.width), i, np.uint8)
        place = folder / frame.camera_name if by_camera else folder
        write_image_atomic(place / f"{frame.name}.png", picture)
    return folder


@pytest.mark.parametrize("by_camera", [True, False])
def test_each_frame_has_the_picture_of_its_name(by_camera: bool, tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    folder = labelled(tmp_path / "labels", drive, by_camera=by_camera)
    opened = open_drive(drive, DriveOptions(labels=str(folder)))
    assert opened.semantic_classes == "cityscapes"
    for i, frame in enumerate(opened.frames):
        assert frame.semantic_path is not None and frame.semantic_path.is_relative_to(folder)
        assert (read_label_image(frame.semantic_path) == i).all()


def test_of_the_frames_that_are_asked_for_alone(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    folder = labelled(tmp_path / "labels", drive, by_camera=True)
    first = next(iter(open_drive(drive).frames))
    (folder / first.camera_name / f"{first.name}.png").unlink()
    assert len(open_drive(drive, DriveOptions(labels=str(folder), frames="1:")).frames)
    with pytest.raises(SettingsError, match=rf"no labels of 1 of \d+ frames.*{first.camera_name}/{first.name}\.png"):
        open_drive(drive, DriveOptions(labels=str(folder)))


def rig(folder: Path) -> Path:
    """The drive with two cameras that have photographs of the same names."""
    drive = make_tiny_drive(folder)
    for i in range(4):
        camera = ("front", "left")[i % 2]
        (folder / "images" / camera).mkdir(exist_ok=True)
        (folder / f"images/{i:02d}.png").rename(folder / f"images/{camera}/{i // 2:02d}.png")

    def change(document: dict) -> None:  # type: ignore[type-arg]
        for i, frame in enumerate(document["frames"]):
            camera = ("front", "left")[i % 2]
            frame.update(camera=camera, file_path=f"images/{camera}/{i // 2:02d}.png")

    edit(drive, change)
    return drive


WAYS = {
    "in folders of cameras": "{camera}/{stem}.png",
    "in folders of cameras, deeper": "train/{camera}/semantic/{stem}.png",
    "camera before": "{camera}_{stem}.png",
    "camera after": "{stem}-{camera}.png",
    "as Cityscapes": "{camera}/{stem}_gtFine_labelTrainIds.png",
    "with the photograph's suffix": "{camera}/{stem}.jpg.png",
    "of other zeros": "{camera}/{number:06d}.png",
    "of other capitals": "{upper}/{stem}.PNG",
}


@pytest.mark.parametrize("way", WAYS)
def test_each_usual_way_of_naming_is_found(way: str, tmp_path: Path) -> None:
    drive = rig(tmp_path / "drive")
    frames = open_drive(drive).frames
    for i, frame in enumerate(frames):
        camera, stem = frame.camera_name, frame.name
        name = WAYS[way].format(camera=camera, stem=stem, number=int(stem), upper=camera.capitalize())
        path = tmp_path / "labels" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image_atomic(path.with_suffix(".png"), np.full((24, 32), i, np.uint8))
        path.with_suffix(".png").rename(path)
    opened = open_drive(drive, DriveOptions(labels=str(tmp_path / "labels")))
    assert [int(semantics_of(f)[0, 0]) for f in opened.frames] == list(range(len(frames)))


def test_two_cameras_with_the_same_names_want_folders_of_their_own(tmp_path: Path) -> None:
    drive = rig(tmp_path / "drive")
    for i in range(2):
        write_image_atomic(tmp_path / f"labels/{i:02d}.png", np.zeros((24, 32), np.uint8))
    with pytest.raises(SettingsError, match=r"no labels of 4 of 4 frames.*CAMERA/STEM\.png"):
        open_drive(drive, DriveOptions(labels=str(tmp_path / "labels")))


def test_of_several_pictures_of_a_frame_that_of_numbers_is_taken(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    for i in range(4):
        for ending, value in (("labelTrainIds", 2), ("labelIds", 11), ("color", 70)):
            write_image_atomic(tmp_path / f"labels/{i:02d}_{ending}.png", np.full((24, 32), value, np.uint8))
    opened = open_drive(drive, DriveOptions(labels=str(tmp_path / "labels")))
    assert {f.semantic_path.name[3:] for f in opened.frames if f.semantic_path} == {"labelTrainIds.png"}


def test_of_two_pictures_that_nothing_tells_apart_neither_is_taken(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    for i in range(4):
        for ending in ("one", "two"):
            write_image_atomic(tmp_path / f"labels/{i:02d}_{ending}.png", np.zeros((24, 32), np.uint8))
    with pytest.raises(SettingsError, match=r"several pictures of each frame: STEM_one\.png, STEM_two\.png"):
        open_drive(drive, DriveOptions(labels=str(tmp_path / "labels")))


def test_instance_maps_are_found_likewise_and_win_over_those_of_the_drive(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    for i in range(4):
        write_image_atomic(tmp_path / f"maps/{i:02d}_instanceIds.png", np.full((24, 32), 40 + i, np.uint16))
    opened = open_drive(drive, DriveOptions(instance_maps=str(tmp_path / "maps")))
    assert [int(instances_of(f)[0, 0]) for f in opened.frames] == [40, 41, 42, 43]
    assert all(f.semantic_path is not None and "semantics" in str(f.semantic_path) for f in opened.frames)


def test_a_folder_and_a_network_are_one_too_many(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="--labels or --segmenter"):
        RunSettings(labels=str(tmp_path), segmenter="network.onnx")


def test_a_relative_folder_is_that_of_the_first_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert RunSettings(labels="labels").drive_options.labels == str(tmp_path / "labels")


def test_pictures_may_lie_as_the_photographs_do(tmp_path: Path) -> None:
    """Of one camera whose photographs lie in two folders of a card."""
    names = [f"images/{100 + i // 6}MEDIA/P_{i:04d}.png" for i in range(12)]
    path = write_transforms(tmp_path / "drive", frames(names))
    for name in names:
        write_picture(tmp_path / "labels" / name.removeprefix("images/"), 1)
    opened = open_drive(path, DriveOptions(labels=str(tmp_path / "labels")))
    assert [f.semantic_path for f in opened.frames] == [tmp_path / "labels" / n.removeprefix("images/") for n in names]


@pytest.mark.parametrize("count", [20, 600])
def test_names_that_could_be_read_in_very_many_ways_end_the_search(count: int, tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")

    def change(document: dict) -> None:  # type: ignore[type-arg]
        for i, frame in enumerate(document["frames"]):
            (tmp_path / "drive" / frame["file_path"]).rename(tmp_path / f"drive/images/{i}.png")
            frame.update(camera="0", file_path=f"images/{i}.png")

    edit(drive, change)
    folder = tmp_path / "labels"
    folder.mkdir()
    for k in range(count):
        (folder / ("0-" * 115 + f"{k}_x.png")).touch()
    begun = time.process_time()
    opened = open_drive(drive, DriveOptions(labels=str(folder)))
    assert [f.semantic_path.name[-8:] for f in opened.frames if f.semantic_path] == [f"-{k}_x.png" for k in range(4)]
    assert time.process_time() - begun < 10


def test_a_number_that_stands_in_all_names_is_no_hindrance(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    folder = tmp_path / "labels"
    folder.mkdir()
    for k in range(1500):
        (folder / f"drive_0000_1_{k:06d}.png").touch()
    opened = open_drive(drive, DriveOptions(labels=str(folder)))
    assert [f.semantic_path and f.semantic_path.name for f in opened.frames][1] == "drive_0000_1_000001.png"
