"""Meshes of neighbouring regions become one."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.mesh.join import joined
from unveil_core.mesh.mesh import Mesh


def some_mesh(generator: np.random.Generator, vertices: int, faces: int) -> Mesh:
    """Vertices of a coarse grid, so that meshes share many."""
    return Mesh(
        generator.integers(-2, 3, (vertices, 3)).astype(np.float32) / 3,
        generator.integers(0, vertices, (faces, 3)).astype(np.int32),
        generator.integers(0, 256, (vertices, 3)).astype(np.uint8),
    )


@given(st.integers(0, 1000), st.lists(st.integers(1, 400), min_size=1, max_size=5))
def test_alike_vertices_become_one_and_triangles_stay_where_they_are(seed: int, counts: list[int]) -> None:
    generator = np.random.default_rng(seed)
    parts = [some_mesh(generator, count, count + 1) for count in counts]
    mesh = joined(iter(parts), [(len(p.vertices), len(p.faces)) for p in parts])
    corners = np.concatenate([p.vertices[p.faces] for p in parts])
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], corners)
    if len(parts) > 1:
        places, first = np.unique(np.concatenate([p.vertices for p in parts]), axis=0, return_index=True)
        assert len(mesh.vertices) == len(places)
        # The first of alike ones stays, and their order.
        colors = np.concatenate([p.colors for p in parts])
        np.testing.assert_array_equal(mesh.colors, colors[np.sort(first)])
