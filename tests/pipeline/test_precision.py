"""Footage of 16 bits whose light changes from frame to frame: what is filled in has as many levels as what was seen, and shines."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests import small_street
from tests.small_street import make_small_street
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

SETTINGS = RunSettings(
    quality="draft", iterations=120, splats=8_000, without=("footage_detail", "ground_grain", "sensor_noise")
)
"""Without what delivery takes from the footage: its detail and its noise have as many levels anyway."""
LORRY = np.array([12.5, -1.7, 3.2])
GAINS = (0.5, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5)
"""Of the frames. Those in the middle are bright, and where the sun lies on the wall they all show the lorry."""


def ramp(p: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Colours (N, 3) of surface points: plaster that brightens along the street, so that hardly two pixels have one value, with a
    patch of sun on the right that is brighter than white at the gain of the bright frames."""
    color = np.repeat((0.35 + 0.01 * np.sin(3 * p[:, 0]) * np.cos(2 * p[:, 1]))[:, None], 3, axis=1)
    color[kind == small_street.SKY] = (0.5, 0.6, 0.75)
    wall = kind == small_street.BUILDING
    x, y, z = p[wall].T
    light = 0.25 + 0.4 * np.clip(x / 45, 0, 1) + z / 40
    light += np.where(y < 0, np.exp(-(((x - 27) / 4) ** 4)), 0) * (1.45 - z / 20)
    color[wall] = light[:, None] * (1.0, 0.97, 0.94)
    color[kind == small_street.CAR] = (0.5, 0.06, 0.06)
    return color


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small street with plaster and a lorry, in changing light; without it in ``truth/deep``."""
    folder = tmp_path_factory.mktemp("street")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(small_street, "shade", ramp)
        patch.setattr(small_street, "HIGH", LORRY)
        path = make_small_street(folder)
        (folder / "truth/deep").mkdir()
        for i, gain in enumerate(GAINS):
            for name, crowded in (("images", True), ("truth/deep", False)):
                colors, _ = small_street.colors_seen(small_street.pose_at(float(i)), crowded)
                codes = np.round(np.clip(gain * colors, 0, 1) * 65535).astype(np.uint16)
                cv2.imwrite(str(folder / f"{name}/{i:02d}.png"), codes)
    return path


@pytest.fixture(scope="module")
def done(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return run(street, tmp_path_factory.mktemp("runs") / "ws", SETTINGS, until="deliver")


def holes(street: Path, done: Workspace) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Of each frame the delivered and the true codes (N, 3) well inside of what was removed, and that which white in the common
    exposure has in it, of green."""
    found = []
    exposures = read_exposures(done.exposure_json)
    for frame in read_imported(done.drive_dir).frames:
        own, delivered, true = (
            cv2.imread(str(p / f"{frame.name}.png"), cv2.IMREAD_UNCHANGED)
            for p in (street.parent / "images", done.root / "frames/camera", street.parent / "truth/deep")
        )
        removed = cv2.imread(str(street.parent / f"truth/removed/{frame.name}.png"), 0)
        wall = (true != own).any(axis=2) & (cv2.erode(removed, np.ones((5, 5))) > 0)
        assert delivered.dtype == np.uint16
        white = exposures.delivered(frame, np.full((1, 1, 3), 255, np.uint8))[0, 0, 1]
        found.append((delivered[wall], true[wall], 257 * float(white)))
    return found


def test_a_hole_has_as_many_levels_as_the_footage(street: Path, done: Workspace) -> None:
    for delivered, true, _ in holes(street, done):
        if len(true) > 300:
            levels, those_of_street = (len(np.unique(codes[:, 1])) for codes in (delivered, true))
            assert levels > 0.9 * those_of_street > 150


def test_highlights_come_back(street: Path, done: Workspace) -> None:
    """What is brighter than white in the common exposure, and not in that of dark frames, comes back in their holes."""
    compared = 0
    for delivered, true, white in holes(street, done):
        bright = true[:, 1] > 1.05 * white
        if white < 65535 and bright.sum() > 30:
            compared += 1
            assert np.percentile(delivered[bright, 1], 75) > 1.03 * white
    assert compared > 1
