"""Headers of PLY that claim more than the file holds, or more than can be read in a while."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from unveil_core.base.checks.ply_headers import read_ply
from unveil_core.base.errors import DriveError
from unveil_core.drives.points import read_points

XYZ = "property float x\nproperty float y\nproperty float z\n"


def ply(path: Path, elements: str, content: bytes, way: str = "binary_little_endian") -> Path:
    path.write_bytes(f"ply\nformat {way} 1.0\n{elements}end_header\n".encode() + content)
    return path


def test_rows_are_counted_with_all_their_properties(tmp_path: Path) -> None:
    path = ply(tmp_path / "p.ply", f"element vertex 90\n{XYZ}", bytes(12 * 90))
    read_ply(path)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(ValueError, match="90 rows, which take 1,080 bytes at least"):
        read_ply(path)


@pytest.mark.parametrize("way", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_empty_faces_by_the_million_are_refused_at_once(tmp_path: Path, way: str) -> None:
    """Each takes a byte, and 20 us to be read."""
    faces = "element face 3000000\nproperty list uchar int vertex_indices\n"
    content = b"1 2 3\n" + b"0\n" * 3_000_000 if way == "ascii" else bytes(12) + bytes(3_000_000)
    path = ply(tmp_path / "p.ply", f"element vertex 1\n{XYZ}{faces}", content, way)
    begun = time.monotonic()
    with pytest.raises(DriveError, match="3,000,000 faces or other lists, of which .* save it without them"):
        read_points(path)
    assert time.monotonic() - begun < 1


def test_a_mesh_is_read_for_its_points(tmp_path: Path) -> None:
    faces = "element face 2000\nproperty list uchar int vertex_indices\n"
    path = ply(tmp_path / "p.ply", f"element vertex 4\n{XYZ}{faces}", bytes(48) + (b"\x03" + bytes(12)) * 2000)
    assert len(read_points(path).positions) == 4
