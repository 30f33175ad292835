"""The points as laspy reads them, and by the rules of PDAL."""

from __future__ import annotations

import json
import shutil
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.exports.conftest import Street
from tests.exports.readers.las import open_as_pdal
from tests.exports.street import CAR, ROAD, WORLD
from unveil_core.app.cli import main
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import read_points, write_points
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.cloud import street_points
from unveil_core.workspace.workspace import Workspace

laspy = pytest.importorskip("laspy")


@pytest.mark.parametrize("name", ["las", "laz"])
def test_positions_colours_and_classes_are_those_of_the_street(name: str, street: Street) -> None:
    if name == "laz":
        pytest.importorskip("lazrs")
    path = street.exported(name)
    las, points = laspy.read(str(path)), street_points(street.job)
    world = WORLD.to_world(points.cloud.positions)
    assert (str(las.header.version), las.header.point_format.id, len(las.points)) == ("1.4", 7, len(world))
    found = np.stack([las.x, las.y, las.z], axis=1)
    np.testing.assert_allclose(found, world, atol=0.5e-3 * WORLD.scale + 1e-8)  # half a millimetre
    color = np.stack([las.red, las.green, las.blue], axis=1)
    np.testing.assert_array_equal(color // 257, points.cloud.colors)
    train_id = np.array(las.train_id)
    assert {ROAD, CAR} <= set(np.unique(train_id))
    np.testing.assert_array_equal(train_id, points.cloud.classes)
    expected = np.select([train_id == ROAD, train_id == CAR], [11, 64 + CAR], 1)
    np.testing.assert_array_equal(las.classification, expected)
    np.testing.assert_array_equal(las.object_id, points.objects)
    assert las.header.are_points_compressed == (name == "laz")


def test_the_bytes_are_those_of_the_standard(street: Street) -> None:
    """Read by the tables of LAS 1.4 R15, not by the library that wrote them."""
    content = street.exported("las").read_bytes()
    assert content[:4] == b"LASF" and content[24:26] == bytes((1, 4)) and content[104] == 7
    (first,), (width,), (count,) = (
        struct.unpack_from(kind, content, at) for kind, at in (("<I", 96), ("<H", 105), ("<Q", 247))
    )
    scales, offsets = (np.array(struct.unpack_from("<3d", content, at)) for at in (131, 155))
    points = street_points(street.job)
    assert count == len(points.cloud.positions) and first + count * width == len(content)
    rows = np.frombuffer(content, np.uint8, count * width, first).reshape(count, width)
    steps = rows[:, :12].copy().view("<i4")
    world = WORLD.to_world(points.cloud.positions)
    np.testing.assert_allclose(steps * scales + offsets, world, atol=0.5e-3 * WORLD.scale + 1e-8)
    np.testing.assert_array_equal(rows[:, 16] == 11, points.cloud.classes == ROAD)
    np.testing.assert_array_equal(rows[:, 30:36].copy().view("<u2") // 257, points.cloud.colors)


def test_removed_objects_are_gone_with_what_lies_in_their_boxes(street: Street) -> None:
    job = street.job
    whole = street_points(Job(Workspace.open(street.root), state="full"))
    empty = street_points(job)
    assert len(whole.cloud.positions) == len(read_points(street.root / "drive/points.ply").positions)
    assert set(np.unique(whole.objects)) == {0, 1, 2, 3} and set(np.unique(empty.objects)) == {0, 3}
    unlabelled = whole.cloud.classes == 255
    assert unlabelled.sum() > 10  # on the first car, see the workspace
    left = empty.cloud.positions[empty.cloud.classes == 255]
    floor = job.objects[0]["box"]["centre"][2] - job.objects[0]["box"]["size"][2] / 2
    assert len(left) < 0.3 * unlabelled.sum()  # no more than what touches the ground
    assert (left[:, 2] < floor + 0.1).all()
    road = (whole.cloud.classes == ROAD).sum()
    assert (empty.cloud.classes == ROAD).sum() == road


@pytest.mark.parametrize("name", ["las", "laz"])
def test_pdal_opens_it(name: str, street: Street) -> None:
    if name == "laz":
        pytest.importorskip("lazrs")
    found = open_as_pdal(street.exported(name))
    assert (found.point_format, found.compressed, found.system) == (7, name == "laz", "")
    assert found.count == len(street_points(street.job).cloud.positions)


def test_pdal_opens_points_without_colours(street: Street, tmp_path: Path) -> None:
    root = elsewhere(street, tmp_path, {})
    points = read_points(root / "drive/points.ply")
    write_points(PointCloud(points.positions), root / "drive/points.ply")
    assert main(["export", str(root), "--to", "las", "-o", str(tmp_path)]) == 0
    assert open_as_pdal(tmp_path / "empty_points.las").point_format == 6


IN_STUTTGART = {"scale": 1.0, "rotation": np.eye(3).tolist(), "translation": [513_000.0, 5_402_000.0, 250.0]}
"""Metres of UTM zone 32 north."""


def elsewhere(street: Street, tmp_path: Path, place: dict[str, object]) -> Path:
    """The workspace with another way to its drive's coordinates."""
    root = tmp_path / "workspace"
    shutil.copytree(street.root, root)
    path = root / "drive/cameras.json"
    data = json.loads(path.read_text())
    data["to_world"].update(place)
    path.write_text(json.dumps(data))
    return root


@pytest.mark.parametrize(("codes", "names"), [("25832", ["25832"]), ("EPSG:25832+7837", ["25832", "7837"])])
def test_the_coordinate_system_is_told_as_text_of_the_first_kind(
    codes: str, names: list[str], street: Street, tmp_path: Path
) -> None:
    pyproj = pytest.importorskip("pyproj")
    root = elsewhere(street, tmp_path, IN_STUTTGART)
    assert main(["export", str(root), "--to", "las", "--epsg", codes, "-o", str(tmp_path)]) == 0
    system = open_as_pdal(tmp_path / "empty_points.las").system
    assert system.startswith(("PROJCS[", "COMPD_CS["))  # WKT 2 has PROJCRS and COMPOUNDCRS
    found = pyproj.CRS.from_wkt(system)
    parts = found.sub_crs_list or [found]
    assert [str(part.to_epsg()) for part in parts] == names
    assert laspy.read(str(tmp_path / "empty_points.las")).header.parse_crs() == found


@pytest.mark.parametrize(
    ("code", "place", "problem"),
    [
        ("25833x", {}, "Not an EPSG code: --epsg 25833x (give a number, as 25832, or two, as 25832+7837)"),
        ("99999", {}, "Not a coordinate system that can be written: EPSG:99999"),
        ("4326", {}, "EPSG:4326 does not measure on a plane (name a projected system"),
        ("25832", {"scale": 0.3048}, "a unit of the drive is 3.281 m, one of EPSG:25832 is 1 m"),
        ("31467", {}, "by EPSG:31467 the drive lies"),
        ("25832", {"translation": [0.0, 0.0, 0.0]}, "by EPSG:25832 the drive lies at 0.00 degrees north, 4.51 east"),
        ("25832", {"rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}, "Up differs: EPSG"),
    ],
)
def test_a_system_that_cannot_be_the_drives_is_one_line(
    code: str,
    place: dict[str, object],
    problem: str,
    street: Street,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("pyproj")
    root = elsewhere(street, tmp_path, {**IN_STUTTGART, **place})
    assert main(["export", str(root), "--to", "png,las", "--epsg", code, "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert problem in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_without_pyproj_a_system_is_refused_in_one_line(
    street: Street, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)  # as Python finds what is not installed
    assert main(["export", str(street.root), "--to", "las", "--epsg", "25832", "-o", str(tmp_path / "out")]) == 2
    assert "Not installed: pyproj, which --epsg needs (pip install '.[exports]'" in capsys.readouterr().err
