"""The points as laspy reads them."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from tests.exports.conftest import Street
from tests.exports.street import CAR, ROAD, WORLD
from unveil_core.drives.points import read_points
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
