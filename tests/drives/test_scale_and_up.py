"""Scale and up of a drive: given, read from the drive, or estimated, and reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import edit
from tests.other_frame import Y_UP_UTM, put_into_other_frame
from tests.plain_ply import read_plain_ply
from tests.small_street import make_small_street
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.ply.writing import write_vertices
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, PointCloud
from unveil_core.drives.importing.whole_drive import import_drive, localized
from unveil_core.drives.scale_and_up import UP_AXES, camera_height, estimate_up, place_drive
from unveil_core.geometry.axes import upright
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import quat_to_rotation
from unveil_core.pipeline.settings import UPS, RunSettings


@pytest.fixture
def street(tmp_path: Path) -> Path:
    return make_small_street(tmp_path / "street")


def unknown(path: Path, up: np.ndarray, scale: float = 1.0) -> Drive:
    """The street in a frame of which nothing is known."""
    return open_drive(put_into_other_frame(path, Similarity(scale, upright(up), np.array([5.0, -3.0, 2.0]))))


def test_metres_with_z_up_are_taken_as_they_are(street: Path) -> None:
    placed = place_drive(open_drive(street))
    assert placed.to_world.shifts_only and not placed.surprising
    assert (placed.scale_source, placed.up_source) == ("metric", "ground")
    assert (
        placed.message()
        == "coordinates are metres, as the drive says; up is taken as z, by cameras and ground; --up decides"
    )


@pytest.mark.parametrize("name", UPS)
def test_any_axis_is_found_to_be_up(street: Path, name: str) -> None:
    placed = place_drive(unknown(street, UP_AXES[name], 7.3))
    assert placed.up_name == name and placed.up_source == "ground"
    assert placed.to_world.scale == pytest.approx(7.3, rel=0.02) and placed.scale_source == "camera height"
    assert placed.surprising
    assert (
        placed.message().startswith("SCALE UNKNOWN: 1 m is taken as 7.")
        and "--scale UNITS_PER_METRE" in placed.message()
    )


def test_any_direction_is_found_to_be_up(street: Path) -> None:
    """As structure from motion leaves it: no axis is near."""
    up = np.array([0.48, -0.64, 0.6])
    placed = place_drive(unknown(street, up))
    assert np.degrees(np.arccos(placed.to_world.up @ up)) < 0.5 and "(0.4" in placed.message()


def test_a_slope_of_the_street_does_not_tilt_a_frame_that_knows_metres(street: Path) -> None:
    """Of structure from motion it does: its frame may well be tilted itself."""
    tilt = Similarity(1.0, quat_to_rotation((np.cos(0.07), 0.0, np.sin(0.07), 0.0)))  # 8 degrees
    drive = open_drive(put_into_other_frame(street, tilt))
    up = tilt.rotation[:, 2]
    assert np.degrees(np.arccos(estimate_up(drive)[0] @ up)) < 0.5
    assert place_drive(replace(drive, units_per_metre=1.0)).up_name == "z"


def test_a_pitched_camera_alone_tells_up_by_its_way(street: Path) -> None:
    drive = open_drive(street)
    c, s = np.cos(0.6), np.sin(0.6)
    pitched = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    frames = []
    for frame in drive.frames:
        pose = frame.camera.world_to_camera.copy()
        pose[:3, :3] = pitched @ pose[:3, :3]
        pose[:3, 3] = -pose[:3, :3] @ frame.camera.centre
        frames.append(replace(frame, camera=replace(frame.camera, world_to_camera=pose)))
    few = PointCloud(drive.points.positions[:40])
    up, source = estimate_up(replace(drive, frames=tuple(frames), points=few, units_per_metre=None))
    assert source == "cameras" and up @ (0, 0, 1) > 0.9999


def test_the_height_is_that_of_the_ground_not_of_what_stands_on_it(street: Path) -> None:
    """A hedge with more points than the road below it, and strays below the ground."""
    drive = open_drive(street)
    generator = np.random.default_rng(3)
    hedge = generator.uniform((0, 2.0, 0.0), (7, 2.6, 1.2), (20_000, 3))
    below = generator.uniform((0, -2.0, -3.0), (7, 2.0, -0.3), (2_000, 3))
    points = PointCloud(np.concatenate([drive.points.positions, hedge, below]))
    assert camera_height(replace(drive, points=points), UP_AXES["z"]) == pytest.approx(1.6, rel=0.02)


def test_without_ground_units_are_metres_and_that_is_said(street: Path) -> None:
    drive = open_drive(street)
    above = PointCloud(drive.points.positions + (0, 0, 50.0))
    placed = place_drive(replace(drive, points=above, units_per_metre=None, up=UP_AXES["z"]))
    assert placed.to_world.scale == 1 and placed.scale_source == "nothing" and "no ground was found" in placed.message()


@pytest.mark.parametrize("height", [1.6, 3.2])
def test_a_height_that_is_given_tells_the_scale(street: Path, height: float) -> None:
    drive = unknown(street, UP_AXES["-y"], 7.3)
    true = camera_height(drive, UP_AXES["-y"])
    assert true is not None
    placed = place_drive(drive, camera_height_m=height)
    assert placed.to_world.scale == pytest.approx(true / height)
    assert placed.scale_source == "given height" and placed.scale_is_known
    assert f"units above the ground, and {height} m as given" in placed.message()
    # A drive that says metres of itself is overruled, as by --scale.
    known = place_drive(open_drive(street), camera_height_m=2 * height)
    assert known.scale_source == "given height"


def test_a_height_without_ground_is_one_line(street: Path) -> None:
    drive = open_drive(street)
    above = drive.points.positions[:30] + (0, 0, 90.0)
    with pytest.raises(DriveError, match="shows no ground below its cameras.*give --scale UNITS_PER_METRE"):
        place_drive(replace(drive, points=PointCloud(above)), camera_height_m=1.6)


def test_scale_and_height_are_one_too_many() -> None:
    with pytest.raises(SettingsError, match="--scale or --camera-height"):
        RunSettings(scale=2.0, camera_height=1.6)
    with pytest.raises(SettingsError, match=r"Out of range: camera_height 0 \(give metres"):
        RunSettings(camera_height=0.0)


def test_what_is_given_decides(street: Path) -> None:
    drive = open_drive(put_into_other_frame(street))
    placed = place_drive(drive, scale=0.1, up="y")
    assert (placed.scale_source, placed.up_source) == ("given", "given") and not placed.surprising
    assert placed.message() == "1 m is 0.1 units, as given; up is y, as given"
    local, plain = localized(drive, placed), localized(open_drive(make_small_street(street.parent / "plain")))
    # Both have their origin amid the cameras, at whole metres: at 3.5 either neighbour is right.
    shift = np.round(local.points.positions[0] - plain.points.positions[0])
    assert np.abs(shift).max() <= 1
    for a, b in zip(local.frames, plain.frames, strict=True):
        assert np.abs(a.camera.world_to_camera[:3, :3] - b.camera.world_to_camera[:3, :3]).max() < 1e-9
        assert np.abs(a.camera.centre - b.camera.centre - shift).max() < 1e-6
    assert np.abs(local.points.positions - plain.points.positions - shift).max() < 1e-6
    world = Y_UP_UTM.to_world(plain.to_world.to_world(plain.points.positions))
    assert np.abs(local.to_world.to_world(local.points.positions) - world).max() < 1e-6
    assert set(UP_AXES) == set(UPS)


@pytest.mark.parametrize(
    ("keys", "scale", "source"),
    [
        ({"metric": True, "applied_scale": 0.5}, 1.0, "metric"),
        ({"metric": False, "applied_scale": 1.0}, None, "camera height"),
        ({"applied_scale": 1.0}, 1.0, "applied_scale"),
        ({"applied_scale": 0.5}, 0.5, "applied_scale"),
        # The cameras would stand 160 m above the ground: it brought something else than metres to the poses.
        ({"applied_scale": 0.01}, None, "camera height"),
        ({"depth_unit_scale_factor": 0.001}, 1.0, "depth unit"),
        ({}, None, "camera height"),
    ],
)
def test_what_a_transforms_json_tells_of_its_scale(street: Path, keys: dict, scale: float | None, source: str) -> None:
    def tell(document: dict) -> None:
        document.pop("metric")
        document.update(keys)
        document["frames"][0]["depth_file_path"] = "depth/00.png"

    edit(street, tell)
    placed = place_drive(open_drive(street))
    assert placed.scale_source == source
    assert placed.to_world.scale == pytest.approx(1.0, rel=0.02) if scale is None else placed.to_world.scale == scale


@pytest.mark.parametrize("name", ["intensity", "scalar_Reflectance"])
def test_points_of_a_laser_scanner_are_metres(street: Path, name: str) -> None:
    edit(street, lambda d: d.pop("metric"))
    path = street.parent / "points.ply"
    vertex = read_plain_ply(path)
    table = np.zeros(len(vertex), dtype=[*vertex.dtype.descr, (name, "<f4")])
    for n in vertex.dtype.names:
        table[n] = vertex[n]
    write_vertices(path, table)
    assert place_drive(open_drive(street)).scale_source == "measured points"


def test_instant_ngp_says_which_way_is_up(street: Path) -> None:
    put_into_other_frame(street, up=[0, 2.0, 0])
    placed = place_drive(open_drive(street))
    assert placed.up_source == "drive" and placed.up_name == "y"
    for bad in ([0, 0], [0, 0, 0], ["a", 0, 0], "y", [0, 0, float("nan")]):
        edit(street, lambda d, bad=bad: d.update(up=bad))
        with pytest.raises(DriveError, match="Not a direction: up"):
            open_drive(street)


def test_a_workspaces_copy_has_metres_whatever_was_estimated_for_it(street: Path) -> None:
    put_into_other_frame(street)
    copy = import_drive(open_drive(street), street.parent.parent / "ws/drive")
    placed = place_drive(open_drive(copy.root))
    assert placed.to_world.shifts_only and not placed.surprising and placed.up_source == "drive"
    assert placed.message() == "coordinates are metres, as an import before has estimated; up is z, as the drive says"
    again = import_drive(open_drive(copy.root), street.parent.parent / "again/drive")
    assert again.scale_source == "camera height"
    assert np.abs(again.to_world.matrix - copy.to_world.matrix).max() < 1e-9
    assert place_drive(open_drive(copy.root), scale=2.0).message().startswith("1 m is 2 units, as given")


@pytest.mark.parametrize("scale", ["much", None, 0, -1.0, float("inf"), float("nan")])
def test_a_scale_that_is_none_is_one_line(street: Path, scale: object) -> None:
    edit(street, lambda d: (d.pop("metric"), d.update(applied_scale=scale)))
    with pytest.raises(DriveError, match="Not a scale: applied_scale"):
        open_drive(street)
