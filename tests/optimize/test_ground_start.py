"""The ground before there is a scene: where it lies, where it is seen, and when it is not asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.textured_street import BOX, GROUND, HEIGHT, WALL_M, WIDTH, TexturedStreet
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.optimize.ground_start import GroundStart, measured_lane, start_ground
from unveil_core.semantics.classes import LabelSet
from unveil_core.semantics.labels import SceneLabels

STREET = TexturedStreet(slope=0.02)
CAMERAS = [STREET.camera(x) for x in np.arange(0.0, 12.0, 2.0)]
PICTURES = [STREET.photograph(c) for c in CAMERAS]
IMAGES = [image for image, _ in PICTURES]
UNMEASURED = [np.zeros((HEIGHT, WIDTH), dtype=bool)] * len(CAMERAS)
NONE = PointCloud(np.zeros((0, 3)))


def drive() -> Drive:
    frames = tuple(Frame(f"{i:02d}", "camera", c, Path(f"{i}.png")) for i, c in enumerate(CAMERAS))
    return Drive(Path("."), frames, NONE)


def without_classes() -> tuple[SceneLabels, list[np.ndarray]]:
    scene = SceneLabels(LabelSet.keep_remove(), "masks", ("remove",), (), (1, 1))
    return scene, [(kind == BOX).astype(np.int64) for _, kind in PICTURES]


def with_classes() -> tuple[SceneLabels, list[np.ndarray]]:
    scene = SceneLabels(LabelSet.cityscapes([0, 2, 10, 13]), "semantics", ("car",), (), (1, 1, 1, 1))
    of_kind = np.array([0, 1, 3, 2])  # road, building, car, sky
    return scene, [of_kind[kind] for _, kind in PICTURES]


@pytest.fixture(scope="module", params=[without_classes, with_classes])
def found(request: pytest.FixtureRequest) -> GroundStart:
    scene, labels = request.param()
    start = start_ground(drive(), scene, IMAGES, labels, measured_lane(drive(), UNMEASURED), budget=8000)
    assert start is not None
    assert start.told_by == "photographs" and abs(start.height - 1.5) < 0.05
    return start


def test_its_height_is_right_to_centimetres(found: GroundStart) -> None:
    near = (found.points[:, 0] > 2) & (found.points[:, 0] < 16) & (np.abs(found.points[:, 1]) < WALL_M)
    error = found.points[near, 2] - STREET.height(found.points[near])
    assert abs(np.median(error)) < 0.03
    assert np.percentile(np.abs(error), 90) < 0.08


def test_sidewalks_lie_over_kerbs() -> None:
    street = TexturedStreet(slope=0.02, kerb=0.15)
    cameras = [street.camera(x) for x in np.arange(0.0, 24.0, 2.0)]
    pictures = [street.photograph(c) for c in cameras]
    frames = tuple(Frame(f"{i:02d}", "camera", c, Path(f"{i}.png")) for i, c in enumerate(cameras))
    scene, of_kind = with_classes()[0], np.array([0, 1, 3, 2])
    start = start_ground(
        Drive(Path("."), frames, NONE),
        scene,
        [image for image, _ in pictures],
        [of_kind[kind] for _, kind in pictures],
        0.0,
        budget=8000,
    )
    assert start is not None
    s = np.arange(4.0, 20.0, 0.5)
    for t in (3.4, 3.8, 4.2, 0.0, 1.0, 2.0):
        at = start.street.path.to_world(np.column_stack([s, np.full_like(s, t), np.zeros_like(s)]))
        assert abs(np.median(start.street.height_at(s, np.full_like(s, t)) - street.height(at))) < 0.03, t


def test_it_is_where_it_is_seen(found: GroundStart) -> None:
    x, y = found.points[:, 0], found.points[:, 1]
    assert 500 < len(found.points) <= 4000
    near = (x > 4) & (x < 14)
    assert (np.abs(y[near]) < WALL_M + 0.7).mean() > 0.97
    # The box stands from 11 to 14 m on the right, and hides what is under it.
    under = (x > 11.7) & (x < 13.3) & (y > -3.7) & (y < -2.5)
    assert under.sum() < 0.2 * 1.6 * 1.2 / found.spacing**2
    lane = (x > 5) & (x < 10) & (np.abs(y) < 1.5)
    assert lane.sum() > 0.85 * 5 * 3 / found.spacing**2


def test_it_leaves_out_what_could_be_removed(found: GroundStart) -> None:
    for shown, (_, kind) in zip(found.shown, PICTURES, strict=True):
        assert not (shown & (kind == BOX)).any()
        assert (shown & (kind == GROUND)).sum() > 0.7 * shown.sum()


def test_who_measured_it_is_not_asked() -> None:
    scene, labels = with_classes()
    assert (
        start_ground(drive(), scene, IMAGES, labels, measured_lane(drive(), [~m for m in UNMEASURED]), budget=8000)
        is None
    )


def test_without_agreement_there_is_none() -> None:
    scene, labels = without_classes()
    noise = [np.random.default_rng(i).integers(0, 255, image.shape).astype(np.uint8) for i, image in enumerate(IMAGES)]
    assert start_ground(drive(), scene, noise, labels, measured_lane(drive(), UNMEASURED), budget=8000) is None


def test_points_tell_where_asphalt_is_plain() -> None:
    plain = TexturedStreet(rough=0.0)
    pictures = [plain.photograph(plain.camera(x))[0] for x in np.arange(0.0, 12.0, 2.0)]
    generator = np.random.default_rng(0)
    places = np.stack([generator.uniform(2, 16, 300), generator.uniform(-4, 4, 300), np.zeros(300)], axis=1)
    places[:, 2] = STREET.height(places)
    leaves = np.stack([generator.uniform(2, 16, 60), generator.uniform(-4, 4, 60), generator.uniform(1, 4, 60)], axis=1)
    scene, labels = with_classes()
    some = replace(drive(), points=PointCloud(np.concatenate([places, leaves])))
    found = start_ground(some, scene, pictures, labels, measured_lane(drive(), UNMEASURED), budget=8000)
    assert found is not None and found.told_by == "points"
    near = (found.points[:, 0] > 3) & (found.points[:, 0] < 15) & (np.abs(found.points[:, 1]) < 4)
    error = found.points[near, 2] - STREET.height(found.points[near])
    assert near.sum() > 500 and abs(np.median(error)) < 0.05
    assert start_ground(drive(), scene, pictures, labels, measured_lane(drive(), UNMEASURED), budget=8000) is None
