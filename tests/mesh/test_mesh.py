"""Cleaning of meshes: what is kept, and that it makes no difference whether the mesh is overwritten."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.mesh.mesh import Mesh, drop_small_components, keep_faces


def random_mesh(vertices: int, faces: int, seed: int) -> Mesh:
    rng = np.random.default_rng(seed)
    return Mesh(
        rng.normal(size=(vertices, 3)).astype(np.float32),
        rng.integers(0, vertices, (faces, 3)).astype(np.int32),
        rng.integers(0, 256, (vertices, 3)).astype(np.uint8),
    )


def corners(mesh: Mesh) -> list[object]:
    return [mesh.vertices[mesh.faces].tolist(), mesh.colors[mesh.faces].tolist()]


@given(st.integers(3, 40), st.integers(0, 60), st.integers(0, 999))
def test_kept_faces_keep_their_corners(vertices: int, faces: int, seed: int) -> None:
    mesh = random_mesh(vertices, faces, seed)
    keep = np.random.default_rng(seed + 1).random(faces) < 0.5
    wanted = [mesh.vertices[mesh.faces[keep]].tolist(), mesh.colors[mesh.faces[keep]].tolist()]
    before = mesh.faces.copy()
    found = keep_faces(mesh, keep)
    assert corners(found) == wanted
    assert np.array_equal(mesh.faces, before)
    assert set(found.faces.ravel()) == set(range(len(found.vertices)))
    overwritten = keep_faces(mesh, keep, overwrite=True)
    for name in ("vertices", "faces", "colors"):
        assert np.array_equal(getattr(overwritten, name), getattr(found, name))


@given(st.integers(3, 40), st.integers(1, 60), st.integers(1, 12), st.integers(0, 999))
def test_pieces_of_fewer_triangles_go(vertices: int, faces: int, smallest: int, seed: int) -> None:
    mesh = random_mesh(vertices, faces, seed)
    # The slow way: faces that share a corner are of one piece.
    piece = np.arange(faces)
    for _ in range(faces):
        for f in range(faces):
            touching = np.isin(mesh.faces, mesh.faces[f]).any(axis=1)
            piece[touching] = piece[touching].min()
    keep = np.bincount(piece, minlength=faces)[piece] >= smallest
    wanted = [mesh.vertices[mesh.faces[keep]].tolist(), mesh.colors[mesh.faces[keep]].tolist()]
    assert corners(drop_small_components(mesh, smallest)) == wanted
    assert corners(drop_small_components(mesh, smallest, overwrite=True)) == wanted
