"""Label pictures of a folder take the place of a drive's own, frame by frame."""

from __future__ import annotations

import shutil
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


def test_pictures_may_lie_as_the_photographs_do(tmp_path: Path) -> None:
    """Of one camera whose photographs lie in two folders of a card."""
    names = [f"images/{100 + i // 6}MEDIA/P_{i:04d}.png" for i in range(12)]
    path = write_transforms(tmp_path / "drive", frames(names))
    for name in names:
        write_picture(tmp_path / "labels" / name.removeprefix("images/"), 0)
    opened = open_drive(path, DriveOptions(labels=str(tmp_path / "labels")))
    assert [f.semantic_path for f in opened.frames] == [tmp_path / "labels" / n.removeprefix("images/") for n in names]


def test_two_cameras_want_folders_of_their_own(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    folder = labelled(tmp_path / "labels", drive, by_camera=False)
    edit(drive, lambda d: [f.update(camera=("front", "left")[i % 2]) for i, f in enumerate(d["frames"])])
    with pytest.raises(SettingsError, match=r"CAMERA/STEM\.png"):
        open_drive(drive, DriveOptions(labels=str(folder)))
    shutil.copytree(folder, folder / "front")
    shutil.copytree(folder, folder / "left", ignore=shutil.ignore_patterns("front"))
    assert all(f.semantic_path is not None for f in open_drive(drive, DriveOptions(labels=str(folder))).frames)


def test_a_folder_and_a_network_are_one_too_many(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="--labels or --segmenter"):
        RunSettings(labels=str(tmp_path), segmenter="network.onnx")


def test_a_relative_folder_is_that_of_the_first_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert RunSettings(labels="labels").drive_options.labels == str(tmp_path / "labels")
