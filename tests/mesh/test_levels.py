"""Meshes from fine to coarse: near the cameras as by one level, beyond it what that one lacks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.mesh.street import HALF_WIDTH, cast, street_camera
from unveil_core.base.frame_cache import FrameCache
from unveil_core.mesh.levels import beyond, fuse_by_distance
from unveil_core.mesh.mesh import Mesh
from unveil_core.mesh.tsdf import DepthView, fuse

CAMERAS = [street_camera(float(x), 160, 220, 144.0) for x in (0, 2, 4)]
VOXEL, DISTANCES = 0.25, (10.0, 20.0, 30.0)


def views() -> list[DepthView]:
    found = []
    for camera in CAMERAS:
        seen = cast(camera)
        found.append(DepthView(camera, seen["depth"], seen["rgb"]))
    return found


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Mesh:
    return by_distance(tmp_path_factory.mktemp("levels"), DISTANCES)


def by_distance(scratch: Path, distances: Sequence[float]) -> Mesh:
    return fuse_by_distance(
        views,
        voxel_size=VOXEL,
        distances=distances,
        region_of=lambda places: np.zeros(len(places), dtype=np.int64),
        cameras=CAMERAS,
        scratch=scratch,
        cache=FrameCache(0),
    )


def test_it_reaches_as_far_as_depth_is_taken_from(mesh: Mesh) -> None:
    furthest = mesh.vertices[:, 0].max() - CAMERAS[-1].centre[0]
    assert 0.85 * DISTANCES[-1] < furthest < 1.1 * DISTANCES[-1]
    ground = np.abs(mesh.vertices[:, 1]) < HALF_WIDTH - 1
    distance = mesh.vertices[ground, 0] - CAMERAS[-1].centre[0]
    # Two hundredths of the distance: far ground is seen at a flat angle.
    assert (np.abs(mesh.vertices[ground, 2]) < 0.1 + 0.02 * np.maximum(distance, 0)).mean() > 0.97


def test_near_the_cameras_it_is_the_finest_level(mesh: Mesh) -> None:
    alone = fuse(views(), voxel_size=VOXEL, max_depth=DISTANCES[0])
    np.testing.assert_array_equal(mesh.vertices[: len(alone.vertices)], alone.vertices)
    np.testing.assert_array_equal(mesh.faces[: len(alone.faces)], alone.faces)


def test_triangles_grow_with_distance(mesh: Mesh) -> None:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    away = a[:, 0] - CAMERAS[-1].centre[0]
    near, middle, far = (np.median(area[(away > low) & (away < low + 4)]) for low in (0, 12, 21))
    assert middle > 2.5 * near and far > 2.5 * middle


def test_levels_overlap_little(mesh: Mesh) -> None:
    """Ground by rays from above: a triangle nearly everywhere, more than one only where levels meet."""
    a, b, c = (mesh.vertices[mesh.faces[:, k], :2].astype(np.float64) for k in range(3))
    lowest = mesh.vertices[mesh.faces, 2].max(axis=1) < 0.8
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    layers = []
    for x in np.arange(6.0, 22.0, 0.5):
        for y in (-1.03, 0.52):
            p = np.array([x + 0.013, y])
            wa = ((b - p)[:, 0] * (c - p)[:, 1] - (b - p)[:, 1] * (c - p)[:, 0]) / np.where(area == 0, np.nan, area)
            wb = ((c - p)[:, 0] * (a - p)[:, 1] - (c - p)[:, 1] * (a - p)[:, 0]) / np.where(area == 0, np.nan, area)
            layers.append(int(((wa >= 0) & (wb >= 0) & (wa + wb <= 1) & lowest).sum()))
    assert np.mean(np.array(layers) >= 1) > 0.75 and np.mean(np.array(layers) > 1) < 0.25 and max(layers) <= 3


def test_only_what_the_fine_mesh_lacks_is_taken() -> None:
    def plane(end: float, step: float) -> Mesh:
        side = np.arange(0, end + step / 2, step, dtype=np.float32)
        n = len(side)
        x, y = np.meshgrid(side, side, indexing="ij")
        first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1, 1)
        faces = np.concatenate([first + [0, n, n + 1], first + [0, n + 1, 1]]).astype(np.int32)
        vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
        return Mesh(vertices, faces, np.zeros((n * n, 3), np.uint8))

    fine, coarse = plane(10, 0.25), plane(20, 0.5)
    rest = beyond(coarse, fine, 0.5)
    centres = rest.vertices[rest.faces].mean(axis=1)
    # Nothing where the fine one lies, but for its border of a metre, where they overlap and leave no crack.
    inner, outer = (
        np.all((centres[:, :2] > low) & (centres[:, :2] < high), axis=1) for low, high in ((1.5, 8.5), (9, 20))
    )
    assert not inner.any() and outer.sum() == (coarse.vertices[coarse.faces].mean(axis=1)[:, :2] > 9).all(axis=1).sum()
    assert beyond(coarse, Mesh.empty(), 0.5) is coarse


def test_an_attempt_that_was_interrupted_goes_on(tmp_path: Path, mesh: Mesh) -> None:
    by_distance(tmp_path, DISTANCES[:1])
    again = by_distance(tmp_path, DISTANCES)
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.faces, mesh.faces)
