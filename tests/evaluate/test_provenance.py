"""Shares, PSNR and reliability of a drive of a few pixels, against numbers by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.evaluate.street_workspace import build_workspace
from unveil_core.base.files import write_image_atomic
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.provenance import provenance_figures, score_provenance
from unveil_core.inpaint.origin import CONTINUED, INVENTED, SEEN_ELSEWHERE
from unveil_core.provenance.certainty import CERTAIN


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_workspace(tmp_path_factory.mktemp("street"), count=1, width=80, height=40)


def test_figures_by_hand(workspace: Path) -> None:
    """Three blocks far apart: sure and right, unsure and right, unsure and wrong."""
    (frame,) = read_imported(workspace / "drive").frames
    street = np.full((40, 80, 3), 100, np.uint8)
    delivered = street.copy()
    delivered[25:35, 60:70] = 160
    origin, level = np.zeros((40, 80), np.uint8), np.full((40, 80), 255, np.uint8)
    for rows, columns, kind, sure in (
        (slice(5, 15), slice(5, 15), SEEN_ELSEWHERE, 254),
        (slice(5, 15), slice(60, 70), CONTINUED, 127),
        (slice(25, 35), slice(60, 70), INVENTED, 127),
    ):
        origin[rows, columns], level[rows, columns] = kind, sure
    write_image_atomic(workspace / "provenance/front/0000.png", origin)
    write_image_atomic(workspace / "certainty/front/0000.png", level)
    score = score_provenance(workspace, frame, delivered, street)
    assert score is not None
    figures = provenance_figures([score, score])
    origins, certainty = figures["provenance"]["origins"], figures["certainty"]
    assert figures["provenance"]["pixels"] == 600
    assert {k: v["share"] for k, v in origins.items()} == pytest.approx(
        {"relit": 0, "seen_elsewhere": 1 / 3, "continued": 1 / 3, "invented": 1 / 3}
    )
    assert origins["invented"]["psnr"] == pytest.approx(20 * np.log10(255 / 60)) and "psnr" not in origins["relit"]
    assert origins["continued"]["psnr"] == np.inf
    assert certainty["expected"] == pytest.approx(2 / 3) and certainty["right"] == pytest.approx(2 / 3)
    assert certainty["certain"] == pytest.approx(1 / 3) and certainty["certain_right"] == 1
    assert certainty["certain_from"] == CERTAIN and certainty["calibration_error"] == pytest.approx(0)
    low, high = certainty["bins"]
    assert (low["pixels"], low["expected"], low["right"]) == pytest.approx((400, 0.5, 0.5))
    assert (high["pixels"], high["expected"], high["right"]) == pytest.approx((200, 1, 1))
    without = score_provenance(workspace, frame, delivered, None)
    assert without is not None
    figures = provenance_figures([without])
    assert "right" not in figures["certainty"] and figures["certainty"]["certain"] == pytest.approx(1 / 3)


def test_a_workspace_that_tells_nothing_has_no_figures(workspace: Path) -> None:
    (frame,) = read_imported(workspace / "drive").frames
    picture = np.zeros((40, 80, 3), np.uint8)
    assert score_provenance(workspace, replace(frame, name="other"), picture, picture) is None
    assert provenance_figures([]) == {}
