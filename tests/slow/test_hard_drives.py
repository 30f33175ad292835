"""Drives as they come, not as they should be: their scenes are no worse than that of the same drive without the fault."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.hard_drives import (
    LINE,
    LONGER,
    SHRINK,
    Outcome,
    check_frames,
    make_tiny_street,
    reconstructed,
    replace_images,
    replace_points,
    salted,
    with_blob,
)
from tests.small_street import CAR, picture, pose_at
from unveil_core.pipeline.run import run


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return reconstructed(make_tiny_street(tmp_path_factory.mktemp("plain") / "street", LINE))


def test_three_hundred_frames_show_the_street_better_than_thirty(tmp_path: Path) -> None:
    few, many = (
        reconstructed(make_tiny_street(tmp_path / f"{n}", list(np.linspace(0, 30, n)), rays=18_000 // n, shrink=4))
        for n in (30, 300)
    )
    assert many.psnr > few.psnr and many.miou > few.miou


def test_a_standing_start(tmp_path: Path, plain: Outcome) -> None:
    outcome = reconstructed(make_tiny_street(tmp_path / "street", [0.0] * 20 + LINE))
    assert outcome.psnr > plain.psnr - 1 and outcome.miou > 0.85


def test_exposure_that_jumps_by_a_factor_of_four(tmp_path: Path, plain: Outcome) -> None:
    path = make_tiny_street(tmp_path / "street", LINE)
    gains = [0.25 if i % 3 == 0 else 1.0 for i in range(len(LINE))]
    replace_images(path, "images", lambda image, i: (image * gains[i]).round().astype(np.uint8))
    outcome = reconstructed(path)
    assert outcome.psnr > plain.psnr - 1 and abs(outcome.miou - plain.miou) < 0.05
    workspace = run(path, tmp_path / "ws", LONGER, until="deliver")
    assert json.loads(workspace.exposure_json.read_text())["figures"]["used"]
    check_frames(workspace, path, 30)
    squares = []
    for i, x in enumerate(LINE):
        removed = picture(pose_at(x), True, SHRINK)[1] == CAR
        empty = picture(pose_at(x), False, SHRINK)[0] * gains[i]
        found = cv2.imread(str(workspace.root / f"frames/camera/{i:03d}.png"))
        squares.append(((found - empty)[removed] / gains[i]) ** 2)  # as if all had been exposed alike
    assert 10 * np.log10(255**2 / np.concatenate(squares).mean()) > 20


def test_wrong_labels(tmp_path: Path, plain: Outcome) -> None:
    path = make_tiny_street(tmp_path / "street", LINE)
    true = make_tiny_street(tmp_path / "true", LINE)
    replace_images(path, "semantics", lambda labels, i: salted(with_blob(labels, 0.01, i), 0.05, i))
    # What single views say wrongly is outvoted.
    outcome = reconstructed(path, judges=true)
    assert outcome.psnr > plain.psnr - 1 and outcome.miou > plain.miou - 0.05


def with_outliers(points: np.ndarray) -> np.ndarray:
    """A tenth of the points anywhere in a box around all."""
    generator = np.random.default_rng(1)
    wrong = generator.random(len(points)) < 0.1
    anywhere = generator.uniform(points.min(axis=0) - 5, points.max(axis=0) + 5, points.shape)
    return np.where(wrong[:, None], anywhere, points)


@pytest.mark.parametrize(
    ("change", "least_psnr"),
    [(with_outliers, 23.0), (lambda p: p[:: len(p) // 150], 19.0)],
    ids=["outliers", "structure from motion"],
)
def test_points_that_are_wrong_or_few(
    tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], least_psnr: float
) -> None:
    path = make_tiny_street(tmp_path / "street", LINE)
    replace_points(path, change)
    outcome = reconstructed(path)
    assert outcome.psnr > least_psnr and outcome.miou > 0.6
