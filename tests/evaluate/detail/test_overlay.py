"""The picture of found, missed and false lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.evaluate.street_workspace import build_workspace
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.detail.overlay import FALSE, FOUND, MISSED, draw_lines


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_workspace(tmp_path_factory.mktemp("street"), count=2, width=192, height=128)


def share(picture: np.ndarray, color: tuple[int, int, int]) -> float:
    return float((picture == color).all(axis=2).mean())


def test_lines_lie_on_the_delivered_frame(workspace: Path) -> None:
    drive = read_imported(workspace / "drive")
    assert drive.truth_root is not None
    picture = draw_lines(workspace, drive.truth_root, drive.frames[0], (192, 128))
    assert picture is not None and picture.shape == (128, 192, 3)
    assert share(picture, FOUND) > 0.002 and share(picture, MISSED) < 0.001
    drawn = np.any([(picture == color).all(axis=2) for color in (FOUND, FALSE, MISSED)], axis=0)
    delivered = read_image(workspace / "frames/front/0000.png")
    assert np.abs(picture.astype(int) - (delivered // 2 + 128))[~drawn].max() <= 1


def test_an_untouched_frame_misses_them(workspace: Path) -> None:
    drive = read_imported(workspace / "drive")
    assert drive.truth_root is not None
    frame = drive.frames[1]
    write_image_atomic(workspace / "frames/front/0001.png", read_image(frame.image_path))
    picture = draw_lines(workspace, drive.truth_root, frame, (96, 64))
    assert picture is not None and picture.shape == (64, 96, 3)
    assert share(picture, MISSED) > share(picture, FOUND)
    assert share(picture, FALSE) > 0


def test_without_a_true_picture_there_is_none(workspace: Path, tmp_path: Path) -> None:
    drive = read_imported(workspace / "drive")
    assert draw_lines(workspace, tmp_path, drive.frames[0], (96, 64)) is None
