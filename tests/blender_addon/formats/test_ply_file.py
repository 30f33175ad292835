"""PLY files of a workspace, read as they were written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
    ],
)
def test_damaged_files_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(ValueError, match=f"a.ply: is no PLY that can be read here: .*{message}"):
        read_ply(tmp_path / "a.ply")
