"""PLYs of others: text and binary, either order of bytes, lists anywhere; and headers that claim more than the file holds."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from unveil_core.base.errors import DriveError
from unveil_core.base.ply.reading import read_vertices
from unveil_core.base.ply.writing import write_vertices
from unveil_core.drives.points import read_points

XYZ = "property float x\nproperty float y\nproperty float z\n"
FACES = "property list uchar int vertex_indices\n"
WAYS = ["ascii", "binary_little_endian", "binary_big_endian"]


def ply(path: Path, elements: str, content: bytes, way: str = "binary_little_endian") -> Path:
    path.write_bytes(f"ply\nformat {way} 1.0\n{elements}end_header\n".encode() + content)
    return path


def rows_of(way: str, code: str, rows: list[tuple[float, ...]]) -> bytes:
    """Numbers in a format; ``code``: of struct, of a row."""
    if way == "ascii":
        return "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[way]
    return b"".join(struct.pack(order + code, *row) for row in rows)


@pytest.mark.parametrize("way", WAYS)
def test_all_kinds_of_numbers_by_old_and_new_names(way: str, tmp_path: Path) -> None:
    old = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
    new = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
    head = "".join(f"property {kind} p{k}\n" for k, kind in enumerate((*old, *new)))
    half = (-128, 255, -32768, 65535, -(2**31), 2**32 - 1, 0.25, 1e300)
    path = ply(tmp_path / "p.ply", f"element vertex 2\n{head}", rows_of(way, "bBhHiIfd" * 2, [half * 2] * 2), way)
    table = read_vertices(path).table
    assert len(table) == 2
    assert [table[f"p{k}"][1] for k in range(16)] == list(half * 2)


@pytest.mark.parametrize("way", WAYS)
def test_lists_before_among_and_behind_the_vertices(way: str, tmp_path: Path) -> None:
    elements = (
        f"element strip 2\nproperty list uchar short corners\nelement vertex 3\nproperty float x\n"
        f"property list uchar double weights\nproperty float y\nproperty int z\nelement face 1\n{FACES}"
    )
    before = rows_of(way, "B3h", [(3, 1, 2, 3)]) + rows_of(way, "B", [(0,)])
    own = rows_of(way, "fB2dfi", [(1, 2, 9, 9, 2, 3)]) + rows_of(way, "fBfi", [(4, 0, 5, 6)])
    own += rows_of(way, "fB1dfi", [(7, 1, 9, 8, -9)])
    path = ply(tmp_path / "p.ply", elements, before + own + rows_of(way, "B3i", [(3, 0, 1, 2)]), way)
    found = read_vertices(path)
    assert found.names == ("x", "y", "z")
    assert [tuple(row) for row in found.table.tolist()] == [(1, 2, 3), (4, 5, 6), (7, 8, -9)]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("way", WAYS[:2])
def test_line_ends_of_all_systems(end: str, way: str, tmp_path: Path) -> None:
    head = f"ply\nformat {way} 1.0\ncomment made  by hand\nobj_info x\n\nelement vertex 2\n{XYZ}end_header\n"
    body = "1 2 3\n\n4 5 6\n".replace("\n", end).encode() if way == "ascii" else struct.pack("<6f", *range(1, 7))
    path = tmp_path / "p.ply"
    path.write_bytes(head.replace("\n", end).encode() + body)
    found = read_vertices(path)
    assert [tuple(row) for row in found.table.tolist()] == [(1, 2, 3), (4, 5, 6)]
    assert found.comments[0] == "made  by hand"


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    table = np.zeros(70_000, [("x", "<f8"), ("red", "u1"), ("id", ">i4"), ("w", "<f4"), ("n", "<u2")])
    for name in table.dtype.names or ():
        table[name] = rng.integers(0, 200, len(table))
    write_vertices(tmp_path / "p.ply", table, ("a line", "two\nlines", "Straße"))
    found = read_vertices(tmp_path / "p.ply")
    assert found.comments == ("a line", "two lines", "Stra?e")
    for name in table.dtype.names or ():
        np.testing.assert_array_equal(found.table[name], table[name])
    head = (tmp_path / "p.ply").read_bytes()[:300].decode("ascii", errors="replace")
    assert "property int id\n" in head and "format binary_little_endian 1.0\n" in head
    write_vertices(tmp_path / "none.ply", table[:0])
    assert len(read_vertices(tmp_path / "none.ply").table) == 0


def test_rows_are_counted_with_all_their_properties(tmp_path: Path) -> None:
    path = ply(tmp_path / "p.ply", f"element vertex 90\n{XYZ}", bytes(12 * 90))
    read_vertices(path)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(ValueError, match="90 rows, which take 1,080 bytes at least"):
        read_vertices(path)


@pytest.mark.parametrize("way", WAYS)
def test_empty_faces_by_the_million_are_refused_at_once_before_the_vertices_and_left_alone_behind(
    tmp_path: Path, way: str
) -> None:
    """Each takes a byte, and microseconds to be read. Here they are nonsense, which only those who do not read them take."""
    faces, point = f"element face 3000000\n{FACES}", f"element vertex 1\n{XYZ}"
    empty = b"?\n" * 3_000_000 if way == "ascii" else b"\xff" * 3_000_000
    one = rows_of(way, "3f", [(1, 2, 3)])
    with pytest.raises(DriveError, match="3,000,000 faces or other lists, of which .* save it without them"):
        read_points(ply(tmp_path / "before.ply", faces + point, empty + one, way))
    assert read_points(ply(tmp_path / "behind.ply", point + faces, one + empty, way)).positions.tolist() == [[1, 2, 3]]


def test_a_mesh_is_read_for_its_points(tmp_path: Path) -> None:
    faces = f"element face 2000\n{FACES}"
    path = ply(tmp_path / "p.ply", f"element vertex 4\n{XYZ}{faces}", bytes(48) + (b"\x03" + bytes(12)) * 2000)
    assert len(read_points(path).positions) == 4


ONE = f"element vertex 1\n{XYZ}"
WRONG = {
    "an element twice": (ONE + ONE, bytes(24), "has the element vertex twice"),
    "a property twice": (ONE + "property int x\n", bytes(16), "has the property x twice"),
    "a kind that is none": ("element vertex 1\nproperty quad x\n", bytes(12), "of no kind that PLY has"),
    "a list without its item": ("element vertex 1\nproperty list uchar x\n", bytes(12), "of no kind that PLY has"),
    "a list counted in floats": (
        "element vertex 1\nproperty list float int x\n",
        bytes(12),
        "counts by fractions",
    ),
    "another word": (ONE + "texture a.png\n", bytes(12), "a line that begins with 'texture'"),
    "faces alone": (f"element face 1\n{FACES}", b"\x03" + bytes(12), "it has no vertices"),
    "a list longer than the file": (
        "element vertex 1\nproperty list uint int x\nproperty int y\n",
        b"\xff" * 8,
        "cut short",
    ),
    "a last list longer than the file": ("element vertex 1\nproperty list uint int x\n", b"\xff" * 8, "cut short"),
    "a list of less than nothing": (
        "element vertex 1\nproperty list char int x\n",
        b"\xff" * 8,
        "a list of -1 numbers",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_header_that_is_wrong_is_told(name: str, tmp_path: Path) -> None:
    elements, content, problem = WRONG[name]
    with pytest.raises(ValueError, match=problem):
        read_vertices(ply(tmp_path / "p.ply", elements, content))


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ("1 2\n", "more or fewer numbers"),
        ("1 2 3 4\n", "more or fewer numbers"),
        ("1 2 300\n", "z has a value that its kind cannot hold"),
        ("1 2 0.5\n", "z has a value that its kind cannot hold"),
        ("1 2 nan\n", "z has a value that its kind cannot hold"),
    ],
)
def test_a_row_of_text_that_is_wrong_is_told(rows: str, problem: str, tmp_path: Path) -> None:
    elements = "element vertex 1\nproperty float x\nproperty float y\nproperty uchar z\n"
    with pytest.raises(ValueError, match=problem):
        read_vertices(ply(tmp_path / "p.ply", elements, rows.encode() + b" " * 20, "ascii"))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 300), noise=st.binary(min_size=1, max_size=8), cut=st.integers(0, 8))
@pytest.mark.parametrize("way", WAYS)
def test_changed_bytes_are_read_or_refused(way: str, at: int, noise: bytes, cut: int, tmp_path: Path) -> None:
    elements = f"element strip 2\n{FACES}{ONE}property list uchar short more\n"
    body = rows_of(way, "B2i", [(2, 7, 8)] * 2) + rows_of(way, "3fB2h", [(1, 2, 3, 2, 4, 5)])
    path = ply(tmp_path / "p.ply", elements, body, way)
    whole = path.read_bytes()
    path.write_bytes(whole[: at % len(whole)] + noise + whole[at % len(whole) + cut :])
    try:
        found = read_vertices(path)
    except (ValueError, LookupError, MemoryError, ArithmeticError):
        return
    assert len(found.table) <= len(whole)
