"""The start of a reconstruction: measured points first, swept ones only where nothing was measured."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.small_street import make_small_street
from unveil_core.base.frame_cache import Frames
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cloud import thin_points
from unveil_core.optimize import start as module
from unveil_core.optimize.start import StartSettings, start_scene
from unveil_core.semantics.labels import choose_labels, frame_labels
from unveil_core.semantics.visibility import points_in_view
from unveil_core.surfels.sky import Sky


def test_pixels_among_close_points_are_measured() -> None:
    camera = Camera(100, 60, 80.0, 80.0, 50.0, 30.0, np.eye(4))
    side = np.arange(-10, 11) * 0.08  # a point at every second pixel or so
    wall = np.stack([*np.meshgrid(side, side), np.full((21, 21), 5.0)], axis=-1).reshape(-1, 3)

    def measured(points: np.ndarray) -> np.ndarray:
        seen = points_in_view(points, np.full(len(points), 0.08), camera, near=0.2)
        return module._measured(seen, camera)

    mask = measured(wall)
    assert mask[30, 50] and mask[38, 42] and not mask[30, 70] and not mask[5, 5]
    # What lies behind the wall or the camera is not seen, and lonely points measure nothing.
    assert not measured(wall * (1, 1, -1)).any()
    assert not measured(wall[::13]).any()


def test_detail_gets_finer_cells_than_a_plain_wall_of_the_same_points() -> None:
    camera = Camera(100, 60, 80.0, 80.0, 50.0, 30.0, np.eye(4))
    x, y = np.meshgrid(np.linspace(-2.8, 2.8, 160), np.linspace(-1.6, 1.6, 100))
    wall = np.stack([x, y, np.full_like(x, 5.0)], axis=-1).reshape(-1, 3)
    image = np.full((60, 100, 3), 120, np.uint8)
    image[:, 50:] = np.random.default_rng(0).integers(0, 255, (60, 50, 1))
    _, detail = module._survey(wall, np.full(len(wall), 0.035), [camera], [image], 0.2)
    left, right = wall[:, 0] < -0.4, wall[:, 0] > 0.4
    assert detail[left].max() < 1 < detail[right].min()
    kept = thin_points(wall, 0.1 * module._cell_share(detail))
    assert right[kept].sum() > 2 * left[kept].sum() > 0


def test_swept_points_never_contradict_measured_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = localized(open_drive(make_small_street(tmp_path)))
    scene = choose_labels(drive)
    images = [read_image(f.image_path) for f in drive.frames]
    labels = [frame_labels(f, scene) for f in drive.frames]
    asked: list[np.ndarray] = []

    def wrong_sweep(cameras, images, usable, settings, **_):  # type: ignore[no-untyped-def]
        """A sweep that finds a wall one metre before every camera, wherever it is allowed to look."""
        asked.extend(usable)
        points = [c.centre + 1.0 * c.rays()[u][::50] for c, u in zip(cameras, usable, strict=True)]
        return np.concatenate(points), np.full(sum(map(len, points)), 0.01)

    monkeypatch.setattr(module, "sweep_points", wrong_sweep)
    surfels = start_scene(drive, scene, images, labels, StartSettings(budget=20_000)).surfels
    allowed = np.mean([u.mean() for u in asked])
    assert 0 < allowed < 0.6, "the measured part of the pictures is not swept"
    sky = scene.labels.index("sky")
    assert all(not (u & (frame == sky)).any() for u, frame in zip(asked, labels, strict=True))
    assert len(surfels) > 500


def test_the_errors_of_a_sky_are_held_for_one_frame_only() -> None:
    generator = np.random.default_rng(0)
    pose = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    camera, sky = Camera(160, 120, 120.0, 120.0, 80.0, 60.0, pose), Sky(torch.rand(3, 16, 32), np.eye(3))
    image = generator.integers(0, 256, (120, 160, 3)).astype(np.uint8)
    masks = [generator.random((120, 160)) < share for share in np.linspace(0.0, 0.9, 40)]
    samples = Frames(40, lambda i: (camera, image, masks[i]))
    together = np.concatenate([np.square(sky.render(c).numpy()[m] - i[m] / 255.0).ravel() for c, i, m in samples])
    tracemalloc.start()
    found = module._sky_error(sky, samples)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == pytest.approx(together.mean(), rel=1e-12)
    assert peak < together.nbytes / 4
