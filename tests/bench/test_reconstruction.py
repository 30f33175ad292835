"""The reconstruction's benchmark on a small street, whose surface is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.small_street import make_small_street
from unveil_core.app.cli import main
from unveil_core.base.errors import SettingsError
from unveil_core.bench import reconstruction
from unveil_core.bench.reconstruction import bench_reconstruction, unobserved_mask
from unveil_core.optimize.presets import ReconstructSettings
from unveil_core.optimize.start import StartSettings


def test_it_measures_views_labels_and_surface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = make_small_street(tmp_path)
    small = ReconstructSettings(iterations=60, sh_degree=0, start=StartSettings(budget=3000), budget=4000)
    monkeypatch.setitem(reconstruction.PRESETS, "draft", small)
    told = bench_reconstruction(drive, quality="draft", every=4, without=("normal",))
    assert told["held_out"]["psnr"] > 15 and told["held_out"]["miou"] > 0.5
    assert told["surfels"] > 500 and told["seconds"] > 0
    json.dumps(told)
    assert told["geometry"]["f_score_0.25"] > 0.5 and told["geometry"]["chamfer_m"] < 1.0


def test_between_pixels_of_a_plane_inverse_depth_is_exact() -> None:
    """The ground before a camera, known at every second pixel."""
    rows = np.arange(20) + 0.5
    depth = np.repeat((1.6 * 30 / rows)[:, None], 24, axis=1)
    depth[:, 12:] = 2.0  # a box in front
    fine, whole = reconstruction._finer(depth, np.ones_like(depth, bool), 4)
    at = (np.arange(80) + 0.5) / 4
    expected = np.repeat((1.6 * 30 / at)[:, None], 96, axis=1)
    ground = whole.copy()
    ground[:, 48:] = False
    assert ground.sum() > 1000
    np.testing.assert_allclose(fine[ground], expected[ground], rtol=1e-9)
    assert not whole[:, 45:51].any(), "nothing between the box and the ground"


def test_unknown_losses_and_qualities_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SettingsError, match="Not a loss: beauty"):
        bench_reconstruction(tmp_path, without=("beauty",))
    assert main(["bench", "reconstruction", str(tmp_path / "nowhere")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_ideal_mask_spares_sky_and_glass() -> None:
    full, left = np.ones((20, 40), np.float32), np.ones((20, 40), np.float32)
    full[:, :10] = left[:, :10] = 0.0  # sky: no surfel before or after
    full[:, 10:20] = left[:, 10:20] = 0.6  # glass
    left[:, 20:30] = 0.2  # a hole
    left[:, 30:] = 0.995  # well covered by other views
    everywhere = np.ones((20, 40), bool)
    mask = unobserved_mask(full, left, everywhere)
    assert mask[:, 20:30].all()
    assert mask.sum() == 200
    assert not unobserved_mask(full, left, ~everywhere).any()


def test_specks_are_no_holes() -> None:
    full, left = np.ones((20, 20), np.float32), np.ones((20, 20), np.float32)
    left[5, 5] = 0
    assert not unobserved_mask(full, left, np.ones((20, 20), bool)).any()
