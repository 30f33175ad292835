"""Meshes through the verb; what the writers do is tested with them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tests.exports.conftest import Street
from tests.exports.street import WORLD


@pytest.mark.parametrize("name", ["ply", "obj", "glb"])
def test_trimesh_reads_vertices_and_triangles(name: str, street: Street) -> None:
    loaded = trimesh.load(street.exported(name), process=False)
    ours = street.job.mesh
    if name == "glb":
        loaded = loaded.to_mesh()
        back = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ np.array(loaded.vertices).T  # y up to z up
        expected = WORLD.scale * ours.vertices + WORLD.directions_to_local(WORLD.translation)
        np.testing.assert_allclose(back.T, expected, atol=1e-5)
    else:
        np.testing.assert_allclose(loaded.vertices, WORLD.to_world(ours.vertices), atol=1e-5)
        np.testing.assert_array_equal(loaded.visual.vertex_colors[:, :3], ours.colors)
    np.testing.assert_array_equal(loaded.faces, ours.faces)
