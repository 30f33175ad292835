"""PLY files of a workspace, read as they were written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from blender_addon.formats.ply_file import read_ply
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points
from unveil_core.geometry.similarity import Similarity
from unveil_core.mesh import Mesh, write_ply


def test_files_are_read_as_they_were_written(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    points = PointCloud(generator.normal(size=(50, 3)) + 6e6, generator.integers(0, 256, (50, 3), dtype=np.uint8))
    write_points(points, tmp_path / "points.ply")
    ply = read_ply(tmp_path / "points.ply")
    assert np.array_equal(ply.positions, points.positions) and np.array_equal(ply.colors, points.colors)
    some = ply.some(np.array([7, 3]))
    assert np.array_equal(some.positions, points.positions[[7, 3]]) and len(some.triangles) == 0
    vertices, faces = generator.normal(size=(30, 3)), generator.integers(0, 30, (12, 3))
    colors = generator.integers(0, 256, (30, 3), dtype=np.uint8)
    write_ply(Mesh(vertices, faces, colors), tmp_path / "mesh.ply", Similarity(translation=np.array([1e6, 0, 0.5])))
    ply = read_ply(tmp_path / "mesh.ply")
    assert np.array_equal(ply.triangles, faces) and np.array_equal(ply.colors, colors)
    assert [float(v) for v in ply.comment("offset").split()] == [1e6, 0.0, 0.5]
    assert np.allclose(ply.positions - (1e6, 0, 0.5), vertices, atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a ply", "does not begin"),
        (b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "format is ascii"),
        (b"ply\nformat binary_little_endian 1.0\n", "no end"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n1234", "cut short"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty half x\nend_header\n1234", "half"),
        (b"ply\nformat\nend_header\n", "format is not told"),
        (b"ply\nelement\nend_header\n", "index"),
        (b"ply\nproperty float x\nend_header\n", "index"),
        (b"ply\nelement vertex 1000000000000000\nproperty float x\nend_header\n", "cut short"),
        (b"ply\nelement vertex 1" + b"0" * 30 + b"\nproperty float x\nend_header\n", "cut short"),
        (b"ply\nelement vertex -4\nproperty float x\nend_header\n" + b"0" * 99, "-4 rows"),
        (b"ply\nelement vertex 99999999999\nend_header\n", "Unable to allocate|too large|no x"),
        (b"ply\nelement vertex 1\nproperty float x\nend_header\n1234", "no y"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex " + b"9" * 30 + b"\nproperty float x\nend_header\n",
            "",
        ),
        (b"ply\n" + b"comment x\n" * 20_000, "no end"),
    ],
)
def test_damaged_files_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(ValueError, match=f"a.ply: Not a PLY that can be read here: .*{message}"):
        read_ply(tmp_path / "a.ply")


HEADER = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n" + b"".join(
    b"property float %c\n" % c for c in b"xyz"
)


@pytest.mark.parametrize("kind", ["int", "uint"])
@pytest.mark.parametrize("index", [3, 2_000_000_000, -5])
def test_triangles_name_vertices_that_are_there(tmp_path: Path, index: int, kind: str) -> None:
    """Blender does not check what a mesh is filled with."""
    faces = b"element face 1\nproperty list uchar %s vertex_indices\nend_header\n" % kind.encode()
    corners = np.array([0, 1, index]).astype("<i4" if kind == "int" else "<u4").tobytes()
    (tmp_path / "m.ply").write_bytes(HEADER + faces + bytes(36) + b"\3" + corners)
    with pytest.raises(ValueError, match="m.ply: .*vertex that is not there"):
        read_ply(tmp_path / "m.ply")


def test_vertices_are_numbers(tmp_path: Path) -> None:
    (tmp_path / "p.ply").write_bytes(HEADER + b"end_header\n" + np.array([0, np.nan] + [0] * 7, "<f4").tobytes())
    with pytest.raises(ValueError, match="not finite"):
        read_ply(tmp_path / "p.ply")


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 300), noise=st.binary(min_size=1, max_size=12), cut=st.integers(0, 12))
def test_changed_bytes_are_read_or_refused(tmp_path: Path, at: int, noise: bytes, cut: int) -> None:
    write_ply(
        Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]] * 9, np.int32), np.zeros((3, 3), np.uint8)),
        tmp_path / "whole.ply",
        Similarity(),
    )
    whole = (tmp_path / "whole.ply").read_bytes()
    at %= len(whole)
    (tmp_path / "m.ply").write_bytes(whole[:at] + noise + whole[at + cut :])
    try:
        found = read_ply(tmp_path / "m.ply")
    except ValueError as error:
        assert "m.ply" in str(error)
    else:
        assert not len(found.triangles) or 0 <= found.triangles.min() <= found.triangles.max() < len(found.vertices)
