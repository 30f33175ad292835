"""Fusion against scenes whose surface is known exactly."""

from __future__ import annotations

import time
import weakref
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.mesh.street import HALF_WIDTH, Car, cast, street_camera
from unveil_core.base.errors import Cancelled, SettingsError
from unveil_core.base.frame_cache import Frames
from unveil_core.base.parallel import threads
from unveil_core.base.progress import Progress
from unveil_core.geometry.camera import Camera
from unveil_core.mesh import DepthView, Mesh, fuse

CAR = Car(9.0, 2.0)


def street_views(count: int = 5, cars: tuple[Car, ...] = (), width: int = 144, height: int = 96) -> list[DepthView]:
    views = []
    for i in range(count):
        camera = street_camera(1.5 * i, width, height)
        seen = cast(camera, cars)
        views.append(DepthView(camera, seen["depth"], seen["rgb"]))
    return views


def look_at(eye: np.ndarray, target: np.ndarray, size: int = 96, focal: float = 110.0) -> Camera:
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return Camera(size, size, focal, focal, size / 2, size / 2, matrix)


def ball_view(eye: np.ndarray, radius: float) -> DepthView:
    """A ball at the origin, red where x > 0 and green elsewhere, before a background beyond every limit of depth."""
    camera = look_at(eye, np.zeros(3))
    rays = camera.rays()
    a, b, c = (rays**2).sum(-1), (rays * eye).sum(-1), (eye**2).sum() - radius**2
    root = b * b - a * c
    depth = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, 12.0)
    points = eye + rays * depth[..., None]
    rgb = np.where(points[..., :1] > 0, (0.9, 0.1, 0.1), (0.1, 0.8, 0.2))
    return DepthView(camera, depth.astype(np.float32), rgb.astype(np.float32))


def ball_views(radius: float = 1.0) -> list[DepthView]:
    directions = [(4, 0, 0.5), (-4, 0.3, 0.2), (0, 4, -0.4), (0.2, -4, 0), (1, 1, 3.5), (-1, 0.5, -3.6)]
    return [ball_view(np.array(d, dtype=np.float64), radius) for d in directions]


def street_error(mesh: Mesh, cars: tuple[Car, ...]) -> np.ndarray:
    """Distance of each vertex to the true surfaces."""
    p = mesh.vertices.astype(np.float64)
    error = np.minimum(np.abs(p[:, 2]), np.abs(np.abs(p[:, 1]) - HALF_WIDTH))
    for car in cars:
        half = np.array([car.half_x, car.half_y, car.height / 2])
        q = np.abs(p - (car.x, car.y, car.height / 2)) - half
        box = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
        error = np.minimum(error, np.abs(box))
    return error


def test_a_street_is_exact_to_a_millimetre() -> None:
    mesh = fuse(street_views(cars=(CAR,)), voxel_size=0.1, max_depth=15.0)
    error = street_error(mesh, (CAR,))
    assert len(mesh.faces) > 20_000
    assert np.median(error) < 1e-4
    assert np.quantile(error, 0.95) < 3e-3
    assert (error > 0.05).mean() < 0.01


def test_flat_road_has_no_holes_where_it_was_seen() -> None:
    assert road_covered(fuse(street_views(8), voxel_size=0.1, max_depth=20.0), within=0.05) == 1.0


def road_covered(mesh: Mesh, within: float) -> float:
    """Share of the road ahead of the first camera, seen at 5 to 14 degrees, that has a triangle above or below it."""
    ground = np.abs(mesh.vertices[mesh.faces][:, :, 2]).max(axis=1) < within
    middle = mesh.vertices[mesh.faces[ground]].mean(axis=1)
    cells = np.zeros((50, 30), dtype=bool)
    x, y = np.floor((middle[:, 0] - 7) / 0.2).astype(int), np.floor((middle[:, 1] + 3) / 0.2).astype(int)
    inside = (x >= 0) & (x < 50) & (y >= 0) & (y < 30)
    cells[x[inside], y[inside]] = True
    return float(cells.mean())


def test_the_crease_between_ground_and_facade_is_closed() -> None:
    mesh = fuse(street_views(8), voxel_size=0.1, max_depth=20.0)
    near = (np.abs(mesh.vertices[:, 2]) < 0.15) & (np.abs(np.abs(mesh.vertices[:, 1]) - HALF_WIDTH) < 0.15)
    for side in (-1, 1):
        x = mesh.vertices[near & (mesh.vertices[:, 1] * side > 0), 0]
        filled = np.isin(np.arange(100, 160), np.floor(x / 0.1).astype(int))
        assert filled.all()


def test_a_ball_in_millimetres() -> None:
    mesh = fuse(ball_views(), voxel_size=0.05, max_depth=10.0)
    radius = np.linalg.norm(mesh.vertices.astype(np.float64), axis=1)
    assert np.abs(radius - 1).mean() < 2e-3
    assert np.quantile(np.abs(radius - 1), 0.99) < 0.01
    outward = (mesh.face_normals() * mesh.vertices[mesh.faces].mean(axis=1)).sum(axis=1)
    assert (outward > 0).mean() > 0.995


def test_colours_are_those_of_the_surface() -> None:
    mesh = fuse(ball_views(), voxel_size=0.05, max_depth=10.0)
    right, left = mesh.vertices[:, 0] > 0.15, mesh.vertices[:, 0] < -0.15
    np.testing.assert_allclose(mesh.colors[right].mean(axis=0), np.array([0.9, 0.1, 0.1]) * 255, atol=3)
    np.testing.assert_allclose(mesh.colors[left].mean(axis=0), np.array([0.1, 0.8, 0.2]) * 255, atol=3)


def test_vertices_are_shared() -> None:
    """A closed surface: every edge of the ball's mesh belongs to two triangles almost everywhere."""
    mesh = fuse(ball_views(), voxel_size=0.05, max_depth=10.0)
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).mean() > 0.99
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)


def test_nothing_where_nothing_was_seen() -> None:
    """What the car hides from every view is a hole; so is what has no depth."""
    hidden = fuse(street_views(2, cars=(CAR,)), voxel_size=0.1, max_depth=15.0)
    open_street = fuse(street_views(2), voxel_size=0.1, max_depth=15.0)

    def ground_behind_the_car(mesh: Mesh) -> int:
        v = mesh.vertices
        under = (np.abs(v[:, 2]) < 0.05) & (np.abs(v[:, 0] - CAR.x) < 1.2) & (np.abs(v[:, 1] - CAR.y) < 0.5)
        return int(under.sum())

    assert ground_behind_the_car(open_street) > 100
    assert ground_behind_the_car(hidden) == 0
    view = street_views(1)[0]
    blind = DepthView(view.camera, np.zeros_like(view.depth), view.rgb)
    assert len(fuse([blind], voxel_size=0.1, max_depth=15.0).faces) == 0
    assert len(fuse([], voxel_size=0.1, max_depth=15.0).faces) == 0


@pytest.mark.parametrize("nothing", [0.0, np.inf, np.nan, -1.0])
def test_every_way_of_saying_no_depth(nothing: float) -> None:
    view = street_views(1)[0]
    depth = view.depth.copy()
    depth[depth == 0] = nothing
    depth[:, :72] = nothing
    mesh = fuse([DepthView(view.camera, depth, view.rgb)], voxel_size=0.15, max_depth=15.0)
    assert len(mesh.faces) > 1000
    assert np.isfinite(mesh.vertices).all()
    # The left half of the picture is y > 0.
    assert mesh.vertices[:, 1].max() < 0.2


def noisy_views(noise: float) -> list[DepthView]:
    """The street with each depth off by a share of itself."""
    rng, noisy = np.random.default_rng(0), []
    for view in street_views(8):
        factor = 1 + noise * rng.standard_normal(view.depth.shape)
        noisy.append(DepthView(view.camera, (view.depth * factor).astype(np.float32), view.rgb))
    return noisy


def test_noise_does_not_tear_the_road() -> None:
    """Normals of noisy depth look steeper than the road is: that must not count as free space above it."""
    mesh = fuse(noisy_views(0.03), voxel_size=0.1, max_depth=20.0)
    assert road_covered(mesh, within=0.15) == 1.0
    assert np.median(street_error(mesh, ())) < 0.022


def test_noise_is_averaged() -> None:
    mesh = fuse(noisy_views(0.01), voxel_size=0.1, max_depth=12.0)
    error = street_error(mesh, ())
    # One view alone is wrong by 1 % of up to 12 m along its ray.
    assert np.median(error) < 0.015
    assert np.quantile(error, 0.95) < 0.08


def fused_by(count: int, views: list[DepthView], *, voxel_size: float) -> Mesh:
    with threads(count):
        return fuse(views, voxel_size=voxel_size, max_depth=12.0)


def test_one_thread_means_one() -> None:
    """All that a process computes, this thread has computed."""
    views = street_views(3)
    fused_by(1, views, voxel_size=0.2)  # compiled, or read from the cache
    alone, together = -time.thread_time(), -time.process_time()
    fused_by(1, views, voxel_size=0.06)
    alone, together = alone + time.thread_time(), together + time.process_time()
    assert together < 1.1 * alone + 0.02


def test_the_same_whatever_the_threads() -> None:
    views = street_views(3, cars=(CAR,))
    first, second = (fused_by(count, views, voxel_size=0.15) for count in (3, 1))
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)
    np.testing.assert_array_equal(first.colors, second.colors)


def test_views_of_a_long_drive_are_not_kept() -> None:
    alive: weakref.WeakSet[DepthView] = weakref.WeakSet()
    most = 0

    def make(i: int) -> DepthView:
        nonlocal most
        camera = street_camera(1.5 * i)
        seen = cast(camera)
        weight = None if i % 2 else np.full(seen["depth"].shape, 0.5)
        view = DepthView(camera, seen["depth"], seen["rgb"], weight)
        alive.add(view)
        most = max(most, len(alive))
        return view

    mesh = fuse(Frames(6, make), voxel_size=0.2, max_depth=10.0)
    assert len(mesh.faces) > 1000
    assert most <= 2


def test_an_interrupted_attempt_is_gone_on_with_and_ends_the_same(tmp_path: Path) -> None:
    cameras = [street_camera(1.5 * i) for i in range(6)]
    made: list[int] = []

    def make(i: int) -> DepthView:
        made.append(i)
        seen = cast(cameras[i])
        return DepthView(cameras[i], seen["depth"], seen["rgb"], None if i % 2 else np.full(seen["depth"].shape, 0.5))

    def region_of(places: NDArray[np.float64]) -> NDArray[np.int64]:
        return (places[:, 0] > 6).astype(np.int64)

    def stopped(after: int) -> Progress:
        calls = iter(range(after))

        def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
            if next(calls, None) is None:
                raise KeyboardInterrupt

        return progress

    whole = fuse([make(i) for i in range(6)], voxel_size=0.2, max_depth=10.0, region_of=region_of)
    made.clear()
    for after in (4, 9, 16):
        with pytest.raises(KeyboardInterrupt):
            fuse(
                Frames(6, make),
                voxel_size=0.2,
                max_depth=10.0,
                region_of=region_of,
                cameras=cameras,
                scratch=tmp_path,
                progress=stopped(after),
            )
    assert made == [0, 1, 2, 3, 4, 5]
    assert [path.name for path in (tmp_path / "regions").iterdir()] == ["0.npz"]
    again = fuse(
        Frames(6, make), voxel_size=0.2, max_depth=10.0, region_of=region_of, cameras=cameras, scratch=tmp_path
    )
    assert len(made) == 6
    assert all(np.array_equal(value, getattr(again, name)) for name, value in vars(whole).items())


def test_limits_of_depth_and_space() -> None:
    views = street_views(2)
    near = fuse(views, voxel_size=0.15, max_depth=6.0)
    assert 0 < near.vertices[:, 0].max() < 1.5 + 6.0 + 0.7
    box = np.array([[3.0, -2.0, -1.0], [8.0, 2.0, 1.0]])
    cropped = fuse(views, voxel_size=0.15, max_depth=15.0, bounds=box)
    assert len(cropped.faces) > 500
    assert (cropped.vertices >= box[0]).all()
    assert (cropped.vertices <= box[1]).all()


def test_weights_decide() -> None:
    """Two views that disagree: the trusted one wins."""
    view = street_views(1)[0]
    ones = np.ones_like(view.depth)
    wrong = DepthView(view.camera, view.depth * 1.02, view.rgb, weight=ones * 1e-4)
    mesh = fuse([wrong, DepthView(view.camera, view.depth, view.rgb, weight=ones)], voxel_size=0.1, max_depth=10.0)
    assert np.median(street_error(mesh, ())) < 1e-3


def test_small_pieces_are_dropped() -> None:
    views = street_views(2)
    speck = views[0].depth.copy()
    speck[:20, 60:84] = 2.0
    speckled = [DepthView(views[0].camera, speck, views[0].rgb), views[1]]
    kept = fuse(speckled, voxel_size=0.1, max_depth=12.0, smallest_triangles=1)
    cleaned = fuse(speckled, voxel_size=0.1, max_depth=12.0, smallest_triangles=300)
    assert street_error(kept, ()).max() > 0.3
    assert street_error(cleaned, ()).max() < 0.3


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"voxel_size": 0.0}, "voxel_size"),
        ({"voxel_size": float("nan")}, "voxel_size"),
        ({"voxel_size": 0.1, "truncation": 0.1}, "truncation"),
        ({"voxel_size": 0.1, "max_depth": -1.0}, "max_depth"),
        ({"voxel_size": 0.1, "bounds": [[0, 0, 0], [1, 0, 1]]}, "bounds"),
        ({"voxel_size": 0.002}, "voxel_size"),
    ],
)
def test_settings_that_cannot_work(settings: dict, word: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unveil_core.mesh.tsdf.LARGEST_BLOCKS", 20_000)
    with pytest.raises(SettingsError, match=word):
        fuse(street_views(1), **{"max_depth": 15.0, **settings})


def test_wrong_shapes_are_refused() -> None:
    view = street_views(1)[0]
    with pytest.raises(ValueError, match="view 0"):
        fuse([DepthView(view.camera, view.depth[:10], view.rgb)], voxel_size=0.1)


def test_progress_counts_up_and_may_cancel() -> None:
    seen: list[tuple[int, int]] = []
    fuse(street_views(3), voxel_size=0.2, max_depth=10.0, progress=lambda d, t, m="", **k: seen.append((d, t)))
    assert [d for d, _ in seen] == list(range(1, 9))
    assert {t for _, t in seen} == {8}

    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        fuse(street_views(1), voxel_size=0.2, progress=stop)


@pytest.mark.parametrize("width", [1.7, 4.0])
def test_regions_give_the_mesh_of_one_piece(width: float) -> None:
    whole = fuse(street_views(6, (CAR,)), voxel_size=0.15, max_depth=15.0)
    asked: list[int] = []

    def region_of(places: np.ndarray) -> np.ndarray:
        asked.append(len(places))
        return np.floor(places[:, 0] / width).astype(np.int64)

    parts = fuse(street_views(6, (CAR,)), voxel_size=0.15, max_depth=15.0, region_of=region_of)
    assert len(asked) == 1
    # Vertices of neighbouring cells may coincide, and are one where regions were joined.
    assert len(np.unique(parts.vertices, axis=0)) == len(np.unique(whole.vertices, axis=0)) == len(parts.vertices)
    assert len(parts.faces) == len(whole.faces)

    def triangles(mesh: Mesh) -> np.ndarray:
        corners = np.concatenate(
            [mesh.vertices[mesh.faces].reshape(-1, 9), mesh.colors[mesh.faces].reshape(-1, 9)], axis=1
        )
        return corners[np.lexsort(corners.T)]

    assert np.array_equal(triangles(parts), triangles(whole))
