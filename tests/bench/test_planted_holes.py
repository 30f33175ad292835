"""The benchmark of planted holes: what it reads of the check on real footage, which is tested in tests/evaluate/holdout."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.real_drives.planted_holes import blurred, row_of
from unveil_core.app.holdout_check import holdout_lines

PSNR = {"ours": 25.0, "render": 24.9, "telea": 21.0, "shift_map": 22.5, "blurred": 30.0}


@pytest.fixture
def found() -> dict[str, Any]:
    """What a check finds of one car, as :func:`unveil_core.app.holdout_check.check_footage` returns it."""
    methods = {name: {"psnr": psnr, "ssim": 0.7, "frames": 4} for name, psnr in PSNR.items()}
    return {
        "frames": 4,
        "cars": [{"number": 1, "along_m": 20.0, "left_m": -3.0, "pixels": 900, "psnr": PSNR}],
        "regions": {"removed": {"pixels": 900, "methods": methods}, "unseen": {"pixels": 900, "methods": methods}},
        "outside": {"changed": 0.0, "mean": 0.0},
        "gradient": dict.fromkeys(PSNR, 0.9),
        "spectrum_4px": dict.fromkeys(PSNR, 0.7),
        "line_recall": {**dict.fromkeys(PSNR, 0.5), "telea": None},
        "false_lines": dict.fromkeys(PSNR, 0.25),
        "flicker": {"methods": {name: {"absolute": 2.0} for name in ("truth", *PSNR)}},
    }


def test_ours_stands_beside_the_best_of_opencv_and_the_ceiling(found: dict[str, Any]) -> None:
    row = row_of(found)
    assert row["best_opencv"] == "shift_map" and row["gain_db"] == 2.5 and row["below_blurred_db"] == 5.0
    removed, unseen = row["regions"]["removed"], row["regions"]["unseen"]
    assert removed["best_opencv"]["psnr"] == 22.5 and removed["ours"]["line_recall"] == 0.5
    assert removed["ours"]["gradient"] == 0.9 and removed["blurred"]["false_lines"] == 0.25
    assert removed["ours"]["spectrum_4px"] == 0.7 and removed["ours"]["spectrum_8px"] is None
    assert "gradient" not in unseen["ours"] and "seen_elsewhere" not in row["regions"]
    assert set(row["flicker"]) == {"ours", "truth", "shift_map"} and row["full_size"] is None


def test_without_a_row_of_opencv_nothing_is_compared_with_it(found: dict[str, Any]) -> None:
    for region in found["regions"].values():
        region["methods"] = {k: v for k, v in region["methods"].items() if k in ("ours", "blurred")}
    row = row_of(found)
    assert row["best_opencv"] is None and row["gain_db"] is None and row["below_blurred_db"] == 5.0


def test_the_terminal_tells_of_the_programs_methods_and_of_lines(found: dict[str, Any]) -> None:
    lines = holdout_lines(found)
    assert "  lines on the ground found / false: Unveil 50 % / 25 %, " in "\n".join(lines)
    assert "Telea - / 25 %" in "\n".join(lines) and not any("blurred" in line for line in lines)


def test_the_ceiling_is_the_photograph_without_its_grain() -> None:
    grain = np.random.default_rng(0).normal(128, 20, (60, 80, 3)).clip(0, 255).astype(np.uint8)
    ceiling = blurred(grain)
    assert ceiling.shape == grain.shape and ceiling.std() < 0.2 * grain.std()
    assert abs(float(ceiling.mean()) - float(grain.mean())) < 2
