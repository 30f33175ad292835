"""Poses and points that cannot be are told before work starts, with the likely mistake; right ones are let alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.checks.seen_street import cameras, seen_street, street_points, with_cameras
from unveil_core.base.drive_options import POSE_CONVENTIONS
from unveil_core.drives.checks.agreement import agreement, tree_of
from unveil_core.drives.checks.conventions import in_convention, pose_in, with_pose_convention
from unveil_core.drives.checks.look_over import looked_over
from unveil_core.drives.checks.matches import matched_pairs, share_explained
from unveil_core.drives.checks.poses import other_convention
from unveil_core.drives.drive import Drive, PointCloud
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.geometry.camera import Camera


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("photographs")


def lines(drive: Drive) -> list[str]:
    return [("ASK " if f.asks else "") + f.line for f in looked_over(drive, place_drive(drive))]


def misread(drive: Drive, native: str, meant: str) -> Drive:
    """The drive as a format reads it whose habit is ``native``, where the file's matrices are meant otherwise."""
    wrong = in_convention([f.camera for f in drive.frames], meant, native)
    return replace(with_cameras(drive, wrong), pose_convention=native)


def test_a_right_drive_is_let_alone(folder: Path) -> None:
    for points in (street_points(), street_points(around=True)):
        assert lines(seen_street(folder, points)) == []
    own = cameras()
    assert (share_explained(matched_pairs(seen_street(folder)), own.__getitem__) or 0) > 0.9


@pytest.mark.parametrize("meant", POSE_CONVENTIONS)
@pytest.mark.parametrize("native", ["opengl", "opencv", "world-to-camera"])
def test_matrices_meant_otherwise_are_named_with_their_option(native: str, meant: str, folder: Path) -> None:
    drive = misread(seen_street(folder, street_points(around=True)), native, meant)
    if native == meant:
        assert lines(drive) == []
        return
    (line,) = lines(drive)
    assert line.startswith("ASK poses, taken as ") and f"add --pose-convention {meant})" in line
    mended = with_pose_convention(drive, meant)
    assert lines(mended) == []
    for one, two in zip(mended.frames, cameras(), strict=True):
        assert np.allclose(one.camera.world_to_camera, two.world_to_camera)


def test_without_telling_photographs_the_points_must_do(folder: Path, tmp_path: Path) -> None:
    grey = seen_street(folder)
    flat = tmp_path / "flat.png"
    cv2.imwrite(str(flat), np.full((160, 240, 3), 120, np.uint8))
    grey = replace(grey, frames=tuple(replace(f, image_path=flat) for f in grey.frames))
    assert lines(grey) == []
    (line,) = lines(misread(grey, "opengl", "opencv"))
    assert line.startswith("ASK poses") and "let the cameras see 0% of the points, and 9" in line
    (line,) = lines(replace(grey, points=replace(grey.points, positions=street_points() - (500.0, 0, 0))))
    assert line.startswith("ASK the cameras see 0.0% of the points, whose middle lies 481 units from them")


LEFT = np.array([0.0, 12.0, 0.0])


def at(camera: Camera, shift: np.ndarray) -> Camera:
    pose = camera.world_to_camera.copy()
    pose[:3, 3] -= pose[:3, :3] @ shift
    return replace(camera, world_to_camera=pose)


ELSEWHERE: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "shifted": (lambda p: p + (4e5, 5e6, 30.0), "points and poses are of different coordinates"),
    "far before the cameras, small": (
        lambda p: 0.1 * p + (60.0, 0, 0),
        "points and poses are of different coordinates",
    ),
    "in millimetres": (lambda p: 1000 * p, "if they are millimetres"),
    "in centimetres": (lambda p: 100 * p, "if they are centimetres"),
    "y up": (lambda p: p[:, [0, 2, 1]] * (1, 1, -1), r"if their axes are \(x, -z, y\) of the poses'"),
    "z ahead, y down": (lambda p: p[:, [1, 2, 0]] * (-1, -1, 1), r"if their axes are"),
    "to the left, mirrored": (
        lambda p: p * (1, -1, 1),
        r"their axes are \(x, -y, z\) of .*mirrors them",
    ),
}


@pytest.mark.parametrize("how", ELSEWHERE)
def test_points_of_other_coordinates_are_told(how: str, folder: Path) -> None:
    change, line = ELSEWHERE[how]
    points = street_points()
    drive = seen_street(folder, points)
    if "mirrored" in how:  # beside the origin, for the street is alike on both sides
        moved = [at(c, LEFT) for c in cameras()]
        drive, points = with_cameras(drive, moved), points + LEFT
        assert lines(replace(drive, points=PointCloud(points))) == []
    (told,) = lines(replace(drive, points=PointCloud(change(points))))
    assert told.startswith("ASK ")
    assert re.search(line, told), told


def test_poses_of_other_frames_disagree_with_the_photographs(folder: Path) -> None:
    drive = seen_street(folder, street_points(around=True))
    told = lines(with_cameras(drive, cameras()[::-1]))
    assert len(told) == 1 and "photographs disagree with their poses: these explain 0%" in told[0]


def test_of_a_mistake_that_explains_half_the_points_tell(folder: Path) -> None:
    """Along a straight way an inverse leaves up to 0.8 of the rays that meet; only what they show is nowhere."""
    drive = misread(seen_street(folder, street_points(around=True)), "opengl", "world-to-camera")
    points, pairs = drive.points.positions, matched_pairs(drive)
    tree = tree_of(points)
    own = agreement(pairs, [f.camera for f in drive.frames].__getitem__, tree)
    assert own.share is not None and own.apart is not None and own.apart > 0.2
    for share in (own.share, 0.6, 0.75):
        found = other_convention(drive, points, pairs, replace(own, share=share), tree)
        assert found is not None and found.mend == "add --pose-convention world-to-camera"
    near = replace(own, share=0.6, apart=0.03)
    assert other_convention(drive, points, pairs, near, tree) is None
    assert other_convention(drive, np.zeros((0, 3)), pairs, replace(near, apart=None), None) is None


def test_a_still_camera_is_told(folder: Path) -> None:
    drive = seen_street(folder)
    still = [at(c, cameras()[0].centre - c.centre + 1e-12 * k) for k, c in enumerate(cameras())]
    assert "all 5 frames of camera camera are at one place (add their poses, which may be missing)" in lines(
        with_cameras(drive, still)
    )


def test_a_matrix_comes_back_from_each_convention() -> None:
    camera = cameras()[2]
    for native in POSE_CONVENTIONS:
        for other in POSE_CONVENTIONS:
            (there,) = in_convention([camera], native, other)
            (back,) = in_convention([there], other, native)
            assert np.allclose(back.world_to_camera, camera.world_to_camera, atol=1e-12)
    assert np.allclose(pose_in(camera.camera_to_world, "opencv"), camera.world_to_camera)
    assert np.allclose(pose_in(camera.world_to_camera, "world-to-camera"), camera.world_to_camera)
