"""Points in PLY files of others: colours of any depth, and files that say more than they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import read_points, write_points


def ply(kind: str, colors: list[list[float]], *, text: bool = False) -> bytes:
    table = np.zeros(len(colors), [(n, "<f4") for n in "xyz"] + [(n, kind) for n in ("red", "green", "blue")])
    for name, values in zip(("red", "green", "blue"), zip(*colors, strict=True), strict=True):
        table[name] = values
    names = {"<f4": "float", "u1": "uchar", "<u2": "ushort", "<i4": "int"}
    fields = "".join(f"property {names[table.dtype[n].str.replace('|', '')]} {n}\n" for n in table.dtype.names or ())
    head = f"ply\nformat {'ascii' if text else 'binary_little_endian'} 1.0\nelement vertex {len(table)}\n{fields}end_header\n"
    rows = "".join(" ".join(map(str, row)) + "\n" for row in table.tolist()).encode() if text else table.tobytes()
    return head.encode() + rows


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize(
    ("kind", "given_colors", "read"),
    [
        ("u1", [[255, 128, 0]], [[255, 128, 0]]),
        ("<u2", [[65535, 32896, 0]], [[255, 128, 0]]),
        ("<u2", [[255, 128, 0]], [[255, 128, 0]]),
        ("<i4", [[255, -3, 0]], [[255, 0, 0]]),
        ("<f4", [[1.0, 0.5, 0.0]], [[255, 128, 0]]),
        ("<f4", [[255.0, 128.0, np.nan]], [[255, 128, 0]]),
    ],
)
def test_colours_of_any_depth(
    tmp_path: Path, kind: str, given_colors: list[list[float]], read: list[list[int]], *, text: bool
) -> None:
    path = tmp_path / "points.ply"
    path.write_bytes(ply(kind, given_colors, text=text))
    colors = read_points(path).colors
    assert colors is not None
    assert colors.tolist() == read


HEAD = b"ply\nformat ascii 1.0\n"
XYZ = b"property float x\nproperty float y\nproperty float z\n"
HOSTILE = {
    "a count beyond any memory": HEAD + b"element vertex 1000000000000\n" + XYZ + b"end_header\n0 0 0\n",
    "a count below zero": HEAD + b"element vertex -1\n" + XYZ + b"end_header\n",
    "a count of thirty digits": HEAD + b"element vertex " + b"9" * 30 + b"\n" + XYZ + b"end_header\n",
    "a count of 5,000 digits": HEAD + b"element vertex " + b"9" * 5000 + b"\n" + XYZ + b"end_header\n",
    "a list beyond any memory": HEAD
    + b"element vertex 1\nproperty list int float x\nproperty float y\nproperty float z\nend_header\n100000000000 0 0\n",
    "rows of lists beyond any memory": HEAD
    + b"element face 100000000000\nproperty list uchar int vertex_indices\nelement vertex 1\n"
    + XYZ
    + b"end_header\n3 0 1 2\n0 0 0\n",
    "an element without a name": HEAD + b"element\nend_header\n",
    "a property before its element": HEAD + b"property float x\nend_header\n",
    "a format without a name": b"ply\nformat\nend_header\n",
    "text where numbers belong": HEAD + b"element vertex 1\n" + XYZ + b"end_header\na b c\n",
    "a header without end": HEAD + b"comment x\n" * 20_000,
    "a line without end": HEAD + b"comment " + b"x" * 200_000,
    "no bytes": b"",
    "a list for a coordinate": HEAD
    + b"element vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z\nend_header\n2 1 2 0 0\n",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / "points.ply"
    path.write_bytes(HOSTILE[name])
    with pytest.raises(DriveError, match="points.ply: ") as caught:
        read_points(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 6000


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 400), noise=st.binary(min_size=1, max_size=12), cut=st.integers(0, 12))
@example(at=241, noise=b"\x81\x7f", cut=0)  # a signalling NaN
@pytest.mark.parametrize("text", [False, True])
def test_changed_bytes_are_read_or_refused(tmp_path: Path, at: int, noise: bytes, cut: int, *, text: bool) -> None:
    whole = ply("u1", [[1, 2, 3]] * 9, text=text)
    at %= len(whole)
    path = tmp_path / "points.ply"
    path.write_bytes(whole[:at] + noise + whole[at + cut :])
    try:
        found = read_points(path)
    except DriveError as error:
        assert "points.ply" in str(error)
    else:
        assert np.isfinite(found.positions).all()


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    cloud = PointCloud(
        rng.normal(size=(50, 3)) * 1e6,
        rng.integers(0, 256, (50, 3), dtype=np.uint8),
        classes=rng.integers(0, 19, 50).astype(np.uint8),
        moving=rng.random(50) < 0.5,
    )
    write_points(cloud, tmp_path / "p.ply")
    again = read_points(tmp_path / "p.ply")
    for name in ("positions", "colors", "classes", "moving"):
        assert np.array_equal(getattr(cloud, name), getattr(again, name))


def test_points_that_are_not_finite_are_left_out_and_counted(tmp_path: Path) -> None:
    positions = np.arange(60, dtype=np.float64).reshape(20, 3)
    colors = np.arange(60, dtype=np.uint8).reshape(20, 3)
    spoilt = positions.copy()
    spoilt[3, 1], spoilt[7], spoilt[11, 2] = np.nan, np.inf, -np.inf
    write_points(PointCloud(spoilt, colors), tmp_path / "p.ply")
    told: list[str] = []
    found = read_points(tmp_path / "p.ply", told)
    kept = np.isfinite(spoilt).all(axis=1)
    assert (found.positions == positions[kept]).all() and (found.colors == colors[kept]).all()
    assert told == ["p.ply: 3 of 20 points are NaN or infinite and are left out"]
    with pytest.raises(DriveError, match="3 of 20 points are not finite, the first of them 3"):
        read_points(tmp_path / "p.ply")  # of a workspace, where each point has its place
    write_points(PointCloud(np.full((4, 3), np.nan)), tmp_path / "none.ply")
    with pytest.raises(DriveError, match="4 of 4 points are not finite"):
        read_points(tmp_path / "none.ply", told)
