"""Exposures found from the points of a drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.hard_drives import make_tiny_street, replace_images
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.optimize.exposure import affine_between, fit_exposures

SAMPLES = Path(__file__).parents[2] / "sample_scenes"
GAINS = np.exp(np.linspace(np.log(0.6), np.log(1.1), 8))[:, None] * (1.0, 0.95, 1.05)


def spoilt(image: np.ndarray, i: int) -> np.ndarray:
    """A picture (BGR) of another exposure, the sixth one dazzled."""
    dim = np.clip(image / 255 * GAINS[i, ::-1], 0, 1)
    return np.full_like(image, 255) if i == 5 else (dim * 255).round().astype(np.uint8)


@pytest.mark.parametrize("name", ["parked_street", "country_road"])
def test_a_steady_camera_is_left_alone(name: str) -> None:
    found = fit_exposures(localized(open_drive(SAMPLES / name)))
    assert found.is_identity and not found.known and found.figures["used"] is False
    assert found.figures["rms_with"] > 0.93 * found.figures["rms_without"]


def test_gains_are_found_and_a_frame_that_tells_nothing_is_between_its_neighbours(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", [float(i) for i in range(8)])
    replace_images(path, "images", spoilt)
    drive = localized(open_drive(path))
    found = fit_exposures(drive)
    assert found.figures["used"] and found.figures["rms_with"] < 0.5 * found.figures["rms_without"]
    gain = np.stack([found.of(f).gain for f in drive.frames])
    grey = 0.5 * gain + np.stack([found.of(f).bias for f in drive.frames])
    wanted = 0.5 * GAINS / np.exp(np.log(np.delete(GAINS, 5, axis=0)).mean(axis=0))
    # Blue is never near mid grey on this street, so that its gain and bias are hard to tell apart.
    assert np.abs(np.delete(grey / wanted, 5, axis=0) - 1).max() < 0.05
    assert (gain[4] < gain[5]).all() and (gain[5] < gain[6]).all()
    again = fit_exposures(drive)
    assert all((again.of(f).gain == found.of(f).gain).all() for f in drive.frames)


def test_a_render_is_brought_to_its_photograph_by_least_squares() -> None:
    canonical = np.random.default_rng(0).random((20, 30, 3))
    photograph = np.clip((canonical * (0.5, 0.8, 1.3) + (0.1, 0.0, -0.1)) * 255, 0, 255).round().astype(np.uint8)
    gain, bias = affine_between(canonical, photograph)
    assert np.allclose(gain, (0.5, 0.8, 1.3), atol=0.01) and np.allclose(bias, (0.1, 0.0, -0.1), atol=0.01)
