"""Meshes on disk, read back by other libraries."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.plain_ply import read_plain_ply
from unveil_core.base.errors import WorkspaceError
from unveil_core.geometry.axes import upright
from unveil_core.geometry.similarity import Similarity
from unveil_core.mesh import Mesh, export, read_ply, write_glb, write_obj, write_ply

UTM = np.array([389_512.25, 6_175_034.5, 71.125])
SHIFT = Similarity(translation=UTM)


@pytest.fixture
def mesh() -> Mesh:
    rng = np.random.default_rng(0)
    vertices = rng.uniform(-20, 20, (50, 3)).astype(np.float32)
    faces = rng.permutation(np.arange(48)).reshape(16, 3).astype(np.int32)
    return Mesh(vertices, faces, rng.integers(0, 256, (50, 3)).astype(np.uint8))


def test_ply_opens_elsewhere(mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "deep/er/mesh.ply"
    write_ply(mesh, path)
    vertex = read_plain_ply(path)
    assert vertex["x"].dtype == np.float32
    np.testing.assert_array_equal(np.stack([vertex[a] for a in "xyz"], axis=1), mesh.vertices)
    np.testing.assert_array_equal(np.stack([vertex[c] for c in ("red", "green", "blue")], axis=1), mesh.colors)
    loaded = trimesh.load(path, process=False)
    np.testing.assert_array_equal(loaded.faces, mesh.faces)
    assert [p.name for p in path.parent.iterdir()] == ["mesh.ply"]


def test_ply_keeps_far_coordinates(mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    write_ply(mesh, path, SHIFT)
    vertex = read_plain_ply(path)
    assert vertex["x"].dtype == np.float64
    world = np.stack([vertex[a] for a in "xyz"], axis=1)
    np.testing.assert_allclose(world - UTM, mesh.vertices, atol=1e-8)
    again = read_ply(path, SHIFT)
    np.testing.assert_allclose(again.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    np.testing.assert_array_equal(again.colors, mesh.colors)


@pytest.mark.parametrize("write", [write_ply, write_glb])
def test_a_file_does_not_depend_on_how_much_is_written_at_once(
    write: Callable[..., None], mesh: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(mesh, tmp_path / "at_once", SHIFT)
    monkeypatch.setattr(export, "AT_ONCE", 7)
    write(mesh, tmp_path / "in_pieces", SHIFT)
    assert (tmp_path / "at_once").read_bytes() == (tmp_path / "in_pieces").read_bytes()


def test_ply_of_nothing(tmp_path: Path) -> None:
    write_ply(Mesh.empty(), tmp_path / "mesh.ply", SHIFT)
    assert len(read_ply(tmp_path / "mesh.ply", SHIFT).faces) == 0


def test_damaged_ply_is_one_line(mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    with pytest.raises(WorkspaceError, match="mesh.ply"):
        read_ply(path)
    write_ply(mesh, path)
    content = path.read_bytes()
    for bad in (content[:-5], content[:40], b"", b"hello", content + b"x"):
        path.write_bytes(bad)
        with pytest.raises(WorkspaceError, match=r"mesh\.ply.*unveil mesh"):
            read_ply(path)


def test_obj_keeps_far_coordinates_and_colours(mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.obj"
    write_obj(mesh, path, SHIFT)
    first, *lines = path.read_text().splitlines()
    assert first == f"# unveil mesh, sRGB vertex colours, offset {UTM[0]} {UTM[1]} {UTM[2]}"
    rows = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=np.float64)
    np.testing.assert_allclose(rows[:, :3] - UTM, mesh.vertices, atol=1e-6)
    np.testing.assert_allclose(rows[:, 3:] * 255, mesh.colors, atol=1e-3)
    faces = np.array([line.split()[1:] for line in lines if line.startswith("f ")], dtype=np.int64)
    np.testing.assert_array_equal(faces - 1, mesh.faces)
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.obj"]


def glb_json(path: Path) -> dict:
    content = path.read_bytes()
    magic, version, length = struct.unpack("<III", content[:12])
    assert (magic, version, length) == (0x46546C67, 2, len(content))
    size, kind = struct.unpack("<II", content[12:20])
    assert kind == 0x4E4F534A
    return json.loads(content[20 : 20 + size])


def test_glb_is_y_up_with_the_offset_on_its_node(mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.glb"
    write_glb(mesh, path, SHIFT)
    node = glb_json(path)["nodes"][0]
    assert Similarity.from_json(node["extras"]["to_world"]).translation.tolist() == UTM.tolist()
    assert "scale" not in node
    np.testing.assert_array_equal(node["translation"], [UTM[0], UTM[2], -UTM[1]])
    scene = trimesh.load(path, process=False)
    (geometry,) = scene.geometry.values()
    turned = np.stack([mesh.vertices[:, 0], mesh.vertices[:, 2], -mesh.vertices[:, 1]], axis=1)
    np.testing.assert_allclose(geometry.vertices, turned, atol=1e-6)
    np.testing.assert_array_equal(geometry.faces, mesh.faces)
    corner, _ = scene.bounds
    np.testing.assert_allclose(corner[1], turned[mesh.faces.ravel(), 1].min() + UTM[2], atol=1e-3)


def test_glb_colours_are_linear(mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.glb"
    write_glb(mesh, path)
    document = glb_json(path)
    view = document["bufferViews"][1]
    start = 20 + struct.unpack("<I", path.read_bytes()[12:16])[0] + 8 + view["byteOffset"]
    raw = np.frombuffer(path.read_bytes()[start : start + view["byteLength"]], "<u2").reshape(-1, 4)
    linear = raw[:, :3] / 65535.0
    srgb = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.round(srgb * 255).astype(int), mesh.colors)
    assert (raw[:, 3] == 65535).all()


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (1, 0, 0), (0.1, 0.2, 0.9)])
def test_glb_stands_upright_in_the_worlds_size(mesh: Mesh, tmp_path: Path, up: tuple[float, ...]) -> None:
    path = tmp_path / "mesh.glb"
    to_world = Similarity(0.1, upright(np.array(up)), np.array([3.0, -2.0, 5.0]))
    write_glb(mesh, path, to_world)
    placed = trimesh.load(path, process=False).to_geometry()
    world = to_world.to_world(mesh.vertices)
    np.testing.assert_allclose(placed.vertices[:, 1], world @ np.array(up) / np.linalg.norm(up), atol=1e-5)
    # As the world is but turned, no mirror image: signed volumes stay.
    before, after = (np.linalg.det(v[mesh.faces] - v[0]) for v in (world, np.asarray(placed.vertices)))
    np.testing.assert_allclose(after, before, rtol=1e-3, atol=1e-4)


def test_files_are_in_the_world_whatever_its_unit_and_axes(mesh: Mesh, tmp_path: Path) -> None:
    to_world = Similarity(0.1, upright(np.array([0.0, 1.0, 0.0])), UTM)
    write_ply(mesh, tmp_path / "mesh.ply", to_world)
    write_obj(mesh, tmp_path / "mesh.obj", to_world)
    world = UTM + 0.1 * mesh.vertices[:, [0, 2, 1]].astype(np.float64) * (1, 1, -1)
    vertex = read_plain_ply(tmp_path / "mesh.ply")
    np.testing.assert_allclose(np.stack([vertex[a] for a in "xyz"], axis=1) - UTM, world - UTM, atol=1e-6)
    lines = (tmp_path / "mesh.obj").read_text().splitlines()
    rows = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=np.float64)
    np.testing.assert_allclose(rows - UTM, world - UTM, atol=1e-6)
    np.testing.assert_allclose(read_ply(tmp_path / "mesh.ply", to_world).vertices, mesh.vertices, atol=1e-5)
    header = (tmp_path / "mesh.ply").read_bytes().split(b"end_header")[0].decode()
    assert "comment scale 0.1\n" in header and "comment rotation 1.0 0.0 0.0 0.0 0.0 1.0 0.0 -1.0 0.0\n" in header


def test_glb_of_nothing_is_valid(tmp_path: Path) -> None:
    write_glb(Mesh.empty(), tmp_path / "mesh.glb", SHIFT)
    assert "meshes" not in glb_json(tmp_path / "mesh.glb")
