"""A shot on its way from Blender to a drive: numbers of files, lenses, and what the core reads of what is written."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from blender_addon.formats.shot.lens import PLAIN, ClipLensError, opencv_of_clip
from blender_addon.formats.shot.numbering import clip_plates, image_plates, numbered_name
from blender_addon.formats.shot.place import shot_folder
from blender_addon.formats.shot.writer import Shot, ShotFrame, write_shot
from unveil_core.base.errors import SettingsError
from unveil_core.drives.formats.registry import open_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.pipeline.output_place import check_folder_place


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("plate.1001.exr", "plate.0042.exr"),
        ("sh010_v003_1001.dpx", "sh010_v003_0042.dpx"),
        ("0001_left.png", "0042_left.png"),
        ("99.png", "42.png"),
        ("still.png", "still.png"),
    ],
)
def test_the_last_number_of_a_name_counts(name: str, other: str) -> None:
    assert numbered_name(name, 42) == other


def test_clips_count_from_their_first_file() -> None:
    plates = clip_plates(Path("/p/plate.0990.png"), start=1001, offset=10)
    assert plates.file(1001) == Path("/p/plate.1000.png") and plates.file(1003) == Path("/p/plate.1002.png")
    assert clip_plates(Path("/p/still.png"), 1, 0).file(1) is None


def test_images_count_by_the_numbers_in_their_names() -> None:
    plates = image_plates(Path("/p/plate.1001.png"), start=1, duration=3, offset=1000)
    assert [plates.file(f) and plates.file(f).name for f in (0, 1, 3, 4)] == [
        None,
        "plate.1001.png",
        "plate.1003.png",
        None,
    ]


def libmv(model: str, k: dict[str, float], x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where libmv puts normalized coordinates, y up (its distortion_models.h)."""
    r2 = x * x + y * y
    if model == "POLYNOMIAL":
        bend = 1 + r2 * (k["k1"] + r2 * (k["k2"] + r2 * k["k3"]))
        return x * bend, y * bend
    bend = 1 + r2 * (k["brown_k1"] + r2 * (k["brown_k2"] + r2 * (k["brown_k3"] + r2 * k["brown_k4"])))
    p1, p2 = k["brown_p1"], k["brown_p2"]
    return (
        x * bend + p1 * (r2 + 2 * x * x) + p2 * 2 * x * y,
        y * bend + p2 * (r2 + 2 * y * y) + p1 * 2 * x * y,
    )


@pytest.mark.parametrize("ratio", [1.0, 1.3])
@pytest.mark.parametrize(
    ("model", "k"),
    [
        ("POLYNOMIAL", {"k1": -0.12, "k2": 0.03, "k3": -0.004}),
        (
            "BROWN",
            {
                "brown_k1": -0.1,
                "brown_k2": 0.02,
                "brown_k3": 0.003,
                "brown_k4": 0.0,
                "brown_p1": 0.004,
                "brown_p2": -0.007,
            },
        ),
    ],
)
def test_lenses_bend_as_they_do_in_blender(model: str, k: dict[str, float], ratio: float) -> None:
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-0.6, 0.6, 7), np.linspace(-0.4, 0.4, 5)))
    bent = libmv(model, k, x, y)
    focal = 1000.0 * ratio
    matrix = np.array([[focal, 0, 0], [0, focal, 0], [0, 0, 1]])
    rays = np.stack([x / ratio, -y / ratio, np.ones_like(x)], axis=1)
    lens = np.array(opencv_of_clip(model, k, ratio))
    found, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, lens)
    np.testing.assert_allclose(found[:, 0], np.stack([bent[0], -bent[1]], axis=1) * 1000, atol=1e-6)


def test_other_lenses_want_undistorted_plates() -> None:
    assert opencv_of_clip("DIVISION", {"division_k1": 0.0, "division_k2": 0.0}) == PLAIN
    for model, k in (("NUKE", {"nuke_k1": 0.1}), ("DIVISION", {"division_k1": 0.1, "division_k2": 0.0})):
        with pytest.raises(ClipLensError, match="undistort the plates"):
            opencv_of_clip(model, k)
    brown = dict.fromkeys(("brown_k1", "brown_k2", "brown_k3", "brown_p1", "brown_p2"), 0.0)
    with pytest.raises(ClipLensError, match="k4 of Brown"):
        opencv_of_clip("BROWN", {**brown, "brown_k4": 0.1})


def written(folder: Path, points: np.ndarray | None) -> Path:
    frames = []
    for k in range(3):
        picture = folder / f"plates/plate.{1001 + k}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(picture), np.full((40, 60, 3), 40 * k, np.uint8))
        pose = np.array([[1, 0, 0, 500.25], [0, 0, -1, 2.0 * k], [0, 1, 0, 1.5], [0, 0, 0, 1]])
        frames.append(ShotFrame(1001 + k, picture, pose, (50.0, 51.0), (30.0, 21.0)))
    lens = (-0.1, 0.0, 0.0, 0.002, 0.0, 0.0, 0.0, 0.0)
    with shot_folder(folder / "shot", mend="move it") as files:
        return write_shot(files, Shot("cam A", (60, 40), 24.0, tuple(frames), lens, points))


def test_the_core_reads_what_is_written(tmp_path: Path) -> None:
    """Metres, z up, and an origin that stays: what comes back lies where it came from."""
    points = np.array([[501.0, 5.0, 0.0], [499.0, 8.0, 0.0]])
    drive = open_drive(written(tmp_path, points))
    assert [f.name for f in drive.frames] == ["plate.1001", "plate.1002", "plate.1003"]
    assert drive.frames[0].camera_name == "cam A" and drive.frames[1].timestamp == pytest.approx(1 / 24)
    assert drive.frames[0].distortion is not None and drive.frames[0].distortion.coefficients[3] == 0.002
    placed = localized(drive)
    assert placed.to_world.scale == 1 and not placed.to_world.translation.any()
    np.testing.assert_allclose(placed.frames[2].camera.centre, [500.25, 4.0, 1.5])
    np.testing.assert_array_equal(placed.points.positions, points)


def test_the_command_writes_nothing_into_a_shot(tmp_path: Path) -> None:
    """It is a drive to it, as somebody's is."""
    shot = written(tmp_path, np.ones((5, 3))).parent
    for place in (shot, shot / "results", tmp_path):
        with pytest.raises(SettingsError, match="Not for results"):
            check_folder_place(place)


def test_an_earlier_shot_leaves_no_points(tmp_path: Path) -> None:
    written(tmp_path, np.ones((5, 3)))
    path = written(tmp_path, None)
    assert not (path.parent / "points.ply").exists() and "ply_file_path" not in path.read_text()
