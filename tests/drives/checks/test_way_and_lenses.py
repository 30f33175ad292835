"""Heights, steps and lenses that cannot be are told."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.checks.seen_street import cameras, seen_street, street_points, with_cameras
from unveil_core.drives.checks.findings import Finding, worst_first
from unveil_core.drives.checks.lenses import lens_findings
from unveil_core.drives.checks.look_over import looked_over
from unveil_core.drives.checks.way import way_findings
from unveil_core.drives.drive import Distortion, Drive, Frame, PointCloud
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity


def drive_of(own: list[Camera], points: np.ndarray, *, units: float | None = 1.0) -> Drive:
    frames = tuple(Frame(f"{k:02d}", "camera", c, Path(f"{k:02d}.png")) for k, c in enumerate(own))
    source = "metric" if units else ""
    return Drive(Path("drive"), frames, PointCloud(points), units_per_metre=units, scale_source=source)


def lines(drive: Drive) -> list[str]:
    return [f.line for f in way_findings(drive, drive.points.positions, place_drive(drive))]


def scaled(factor: float) -> Drive:
    """The street in units of which a metre has so many, that says of itself to be in metres."""
    to_units = Similarity(1.0 / factor)
    return drive_of([to_units.camera_to_local(c) for c in cameras()], street_points() * factor)


def test_a_right_way_is_let_alone() -> None:
    assert lines(drive_of(cameras(), street_points())) == []
    assert lines(scaled(1.0)) == []


UNITS = {"centimetres": 100.0, "millimetres": 1000.0, "feet": 3.2808, "inches": 39.37, "kilometres": 0.001}


@pytest.mark.parametrize("unit", UNITS)
def test_heights_that_no_vehicle_has_name_the_unit(unit: str) -> None:
    (line,) = lines(scaled(UNITS[unit]))
    assert "m above the ground" in line and f"coordinates are {unit}? --scale {UNITS[unit]:g} says so" in line


def test_of_a_drone_the_height_is_told_and_no_unit() -> None:
    high = [replace(c, world_to_camera=moved(c, (0, 0, 18.5))) for c in cameras()]
    ground = street_points()
    (line,) = lines(drive_of(high, ground[ground[:, 2] < 0.1]))
    assert "cameras are 20" in line and "a drone, or other units" in line


def test_an_unknown_scale_has_no_height() -> None:
    assert (
        lines(drive_of([Similarity(0.01).camera_to_local(c) for c in cameras()], street_points() * 100, units=None))
        == []
    )


def moved(camera: Camera, shift: tuple[float, float, float]) -> np.ndarray:
    pose = camera.world_to_camera.copy()
    pose[:3, 3] = -pose[:3, :3] @ (camera.centre + shift)
    return pose


def test_a_misplaced_frame_is_named() -> None:
    own = cameras(9)
    own[2] = replace(own[2], world_to_camera=moved(own[2], (0, 400.0, 0)))
    told = lines(drive_of(own, street_points()))
    assert any("frame 02 lies 400 units from its neighbours, which are 0.6 apart" in line for line in told)
    assert any(
        "2 of 8 pairs of neighbouring frames see nothing in common, the first 01 and 02" in line for line in told
    )


def test_frames_that_look_elsewhere_are_named() -> None:
    turned = np.diag([-1.0, 1.0, -1.0, 1.0])
    own = [replace(c, world_to_camera=turned @ c.world_to_camera) if k > 2 else c for k, c in enumerate(cameras())]
    (line,) = lines(drive_of(own, street_points(around=True)))
    assert line.startswith("1 of 4 pairs of neighbouring frames see nothing in common, 02 and 03")


def test_poses_that_are_all_one_are_told() -> None:
    (line,) = lines(drive_of([cameras()[0]] * 4, street_points()))
    assert "all 4 frames of camera camera are at one place" in line


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            {"width": 120, "height": 80},
            r"camera camera lies at 1\.00 of its pictures' width and 1\.00 .*2 times as large: multiply .* by 0\.5\)",
        ),
        ({"width": 480, "height": 320}, r"lies at 0\.25 .*is of pictures 0\.5 times as large: multiply .* by 2\)"),
        ({"cx": 80.0, "cy": 120.0}, r"lies at 0\.33 .*cx and cy are exchanged"),
        ({"cx": 0.0, "cy": 0.0}, r"lies at 0\.00 .*reduced or cropped"),
        ({"height": 100}, r"lies at 0\.50 of its pictures' width and 0\.80 of their height"),
        ({"fx": 24.0, "fy": 24.0}, r"camera camera sees 157 degrees: its focal length is 24 pixels"),
        ({"fx": 0.5, "fy": 0.5, "cx": 0.5, "cy": 0.5}, r"sees 180 degrees: its focal length is 0\.5 pixels"),
        ({"fx": 9000.0, "fy": 9000.0}, r"sees 1\.53 degrees"),
    ],
)
def test_lenses_of_other_pictures_are_told_once(change: dict[str, float], line: str) -> None:
    own = [replace(c, **change) for c in cameras()]
    assert lens_findings(drive_of(cameras(), street_points())) == []
    (found,) = lens_findings(drive_of(own, street_points()))
    assert re.search(line, found.line), found.line


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_focal_length_that_photographs_and_points_contradict_is_told(factor: float, tmp_path: Path) -> None:
    drive = seen_street(tmp_path)
    own = cameras()
    wrong = with_cameras(drive, [replace(c, fx=factor * c.fx, fy=factor * c.fy) for c in own])
    found = looked_over(wrong, place_drive(wrong))
    problem = next(f.problem for f in found if "focal length" in f.problem)
    told = re.search(r"with a focal length of about (\d+) pixels; that of camera camera is (\d+)", problem)
    assert told is not None
    assert int(told[1]) == pytest.approx(own[0].fx, rel=0.2) and int(told[2]) == pytest.approx(
        factor * own[0].fx, abs=1
    )


def test_a_lens_of_other_pictures_asks_where_the_photographs_contradict_it(tmp_path: Path) -> None:
    drive = seen_street(tmp_path)
    half = [replace(c, fx=c.fx / 2, fy=c.fy / 2, cx=c.cx / 2, cy=c.cy / 2) for c in cameras()]
    wrong = with_cameras(drive, half)
    (found,) = looked_over(wrong, place_drive(wrong))
    assert found.asks and "0.5 times as large" in found.mend
    # A part that was cut out of larger pictures has its principal point anywhere, and agrees.
    for frame in drive.frames:
        picture = cv2.imread(str(frame.image_path))
        cv2.imwrite(str(tmp_path / f"cut_{frame.name}.png"), picture[:, :140])
    cut = [replace(c, width=140) for c in cameras()]
    frames = with_cameras(drive, cut).frames
    whole = replace(drive, frames=tuple(replace(f, image_path=tmp_path / f"cut_{f.name}.png") for f in frames))
    (found,) = looked_over(whole, place_drive(whole))
    assert not found.asks and "principal point" in found.problem


def test_a_fisheye_may_see_everything() -> None:
    lens = Distortion("OPENCV_FISHEYE", (0.0, 0.0, 0.0, 0.0))
    own = drive_of([replace(c, fx=20.0, fy=20.0) for c in cameras()], street_points())
    assert len(lens_findings(own)) == 1
    assert lens_findings(replace(own, frames=tuple(replace(f, distortion=lens) for f in own.frames))) == []


def test_what_asks_comes_first() -> None:
    some = [Finding("a", "b"), Finding("c", "d", asks=True), Finding("e", "f")]
    assert [f.problem for f in worst_first(some)] == ["c", "a", "e"]
    assert some[0].line == "a (b)"
