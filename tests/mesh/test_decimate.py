"""Fewer triangles: the surface and its colours stay."""

from __future__ import annotations

import numpy as np
import pytest

from tests.mesh.test_tsdf import ball_views
from unveil_core.base.errors import SettingsError
from unveil_core.mesh import Mesh, decimate, fuse


def sheet(side: int) -> Mesh:
    """A flat square metre of ``side`` x ``side`` vertices; red grows along x, green is a fine checkerboard."""
    i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    x, y = i.ravel() / (side - 1), j.ravel() / (side - 1)
    first = (i[:-1, :-1] * side + j[:-1, :-1]).ravel()
    faces = np.concatenate(
        [np.stack([first, first + side, first + side + 1], 1), np.stack([first, first + side + 1, first + 1], 1)]
    )
    colors = np.stack([250 * x, 200 * ((i + j).ravel() % 2), np.full(x.size, 70)], axis=1)
    return Mesh(
        np.stack([x, y, 0 * x], 1).astype(np.float32), faces.astype(np.int32), np.round(colors).astype(np.uint8)
    )


@pytest.mark.parametrize(("triangles", "lost_area"), [(20, 0.15), (301, 0.02), (2000, 0.001)])
def test_a_flat_sheet_keeps_its_outline_and_colours(triangles: int, lost_area: float) -> None:
    small = decimate(sheet(41), triangles)
    assert 0.9 * triangles <= len(small.faces) <= triangles
    corners = small.vertices[small.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] >= 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx(1.0, abs=lost_area)
    # Each new vertex stands for a patch of this width, whose mean it takes.
    width = 1.5 / np.sqrt(triangles / 2)
    assert np.abs(small.colors[:, 0] / 250 - small.vertices[:, 0]).max() < width
    assert np.abs(small.colors[:, 0] / 250 - small.vertices[:, 0]).mean() < width / 4
    assert (small.colors[:, 2] == 70).all()


def test_grain_is_averaged() -> None:
    green = decimate(sheet(41), 100).colors[:, 1].astype(float)
    assert np.abs(green - 100).mean() < 25


def test_a_ball_stays_round() -> None:
    ball = fuse(ball_views(), voxel_size=0.06, max_depth=6.0)
    small = decimate(ball, 1000)
    assert len(small.faces) in (999, 1000)
    before, after = (np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() for mesh in (ball, small))
    assert before < 0.03 and after < before + 0.005
    red = small.colors[:, 0] > small.colors[:, 1]
    clear = np.abs(small.vertices[:, 0]) > 0.15
    np.testing.assert_array_equal(red[clear], small.vertices[clear, 0] > 0)


def test_enough_is_left_alone() -> None:
    mesh = sheet(5)
    assert decimate(mesh, len(mesh.faces)) is mesh


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(SettingsError, match="3 triangles.*at least 4"):
        decimate(sheet(5), 3)
    mesh = sheet(5)
    pieces = [mesh.vertices + (2 * k, 0, 0) for k in range(10)]
    faces = np.concatenate([mesh.faces + 25 * k for k in range(10)])
    many = Mesh(np.concatenate(pieces).astype(np.float32), faces, np.tile(mesh.colors, (10, 1)))
    with pytest.raises(SettingsError, match="cannot be brought to 9 triangles.*at least"):
        decimate(many, 9)
