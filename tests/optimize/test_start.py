"""The start of a reconstruction: measured points first, swept ones only where nothing was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.small_street import make_small_street
from unveil_core.drives import open_drive
from unveil_core.drives.importing import recentred
from unveil_core.files import read_image
from unveil_core.geometry.camera import Camera
from unveil_core.optimize import reconstruct as module
from unveil_core.optimize.reconstruct import ReconstructSettings, start_scene
from unveil_core.semantics.segment import choose_labels, frame_labels


def test_pixels_near_a_seen_point_are_measured() -> None:
    camera = Camera(100, 60, 80.0, 80.0, 50.0, 30.0, np.eye(4))
    # The second lies behind the first, the third behind the camera.
    points = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 9.0], [1.0, 1.0, -4.0]])
    mask = module._measured(points, np.full(3, 0.2), camera, 0.2)
    assert mask[30, 50] and mask[28, 48] and not mask[26, 50] and not mask[30, 56]
    assert mask.sum() == 25


def test_swept_points_never_contradict_measured_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = recentred(open_drive(make_small_street(tmp_path)))
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
    surfels = start_scene(drive, scene, images, labels, ReconstructSettings(start_budget=20_000))
    allowed = np.mean([u.mean() for u in asked])
    assert 0 < allowed < 0.6, "the measured part of the pictures is not swept"
    sky = scene.labels.index("sky")
    assert all(not (u & (frame == sky)).any() for u, frame in zip(asked, labels, strict=True))
    assert len(surfels) > 500
