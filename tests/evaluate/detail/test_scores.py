"""The sums of a frame, and what their figures say."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.evaluate.detail.pictures import HEIGHT, WIDTH, blurred, road
from tests.mesh.street import street_camera
from unveil_core.base.files import write_image_atomic
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.detail.scores import SPECTRUM_FIGURES, DetailScore, StreetDetail, detail_figures
from unveil_core.evaluate.metrics import gradient
from unveil_core.geometry.images import grow

CAR = (slice(60, 200), slice(120, 320))
RED = (170, 30, 30)


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    write_image_atomic(tmp_path / "semantics/0000.png", np.zeros((HEIGHT, WIDTH), dtype=np.uint8))
    return tmp_path


def region() -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[CAR] = True
    return mask


def crowded() -> np.ndarray:
    picture = road()
    picture[CAR] = RED
    return picture


def detail(truth: Path, **regions: np.ndarray) -> StreetDetail:
    frame = Frame("0000", "front", street_camera(0.0, WIDTH, HEIGHT), truth / "0000.png")
    whole = np.ones((HEIGHT, WIDTH), dtype=bool)
    return StreetDetail(truth, frame, road(), crowded(), {"whole": whole, **regions})


def figures(truth: Path, picture: np.ndarray) -> dict[str, float]:
    return detail_figures([detail(truth, removed=region()).compare(picture).scores["removed"]])


def test_the_true_street(truth: Path) -> None:
    right = dict.fromkeys(("gradient", *SPECTRUM_FIGURES, "line_recall"), 1.0)
    assert figures(truth, road()) == {**right, "false_lines": 0.0, "residue": 0.0}


def test_the_untouched_frame(truth: Path) -> None:
    found = figures(truth, crowded())
    assert found["gradient"] == pytest.approx(0, abs=1e-9)
    # The car's outline is the region's border, and that does not count.
    assert found["line_recall"] < 0.02
    assert found["residue"] > 0.95


def test_a_blurred_street(truth: Path) -> None:
    found = figures(truth, blurred(road(), 4.0))
    assert 0.2 < found["gradient"] < 0.8
    assert found["line_recall"] < 0.05 and found["residue"] == 0
    bands = [found[name] for name in SPECTRUM_FIGURES]
    assert bands == sorted(bands) and bands[0] < 0.1


def test_gradient_is_that_of_the_pixels_without_the_seam(truth: Path) -> None:
    picture, inside = blurred(road(), 1.5), ~grow(~region(), 1)
    expected = gradient(picture)[inside].sum() / gradient(road())[inside].sum()
    assert figures(truth, picture)["gradient"] == pytest.approx(expected, rel=1e-9)


def test_parts_add_up_to_the_whole(truth: Path) -> None:
    upper = region()
    upper[130:] = False
    scores = detail(truth, removed=region(), unseen=upper, seen_elsewhere=region() & ~upper).compare(crowded()).scores
    assert set(scores) == {"removed", "unseen", "seen_elsewhere"}
    for name in ("pixels", "found", "missed", "right", "false", "residue"):
        values = {k: getattr(v, name) for k, v in scores.items()}
        assert values["removed"] == values["unseen"] + values["seen_elsewhere"], name


def test_without_regions_or_ground(truth: Path, tmp_path: Path) -> None:
    assert detail(truth).compare(road()).scores == {}
    assert detail(truth, removed=np.zeros((HEIGHT, WIDTH), dtype=bool)).compare(road()).scores == {}
    score = detail(tmp_path / "elsewhere", removed=region()).compare(road()).scores["removed"]
    found = detail_figures([score])
    assert math.isnan(found["line_recall"]) and math.isnan(found["false_lines"])
    assert found["gradient"] == 1.0


def test_figures_pool_pixels_not_frames() -> None:
    one = DetailScore(100, 10.0, 10.0, 9, 1, 5, 0, 0, 1.0, 9.0, 0.0, 4.0, 9.0, 0.0)
    other = DetailScore(300, 0.0, 30.0, 0, 30, 0, 5, 40, 3.0, 0.0, 0.0, 12.0, 27.0, 0.0)
    found = detail_figures([one, other])
    assert math.isnan(found.pop("spectrum_16px"))
    assert found == {
        "gradient": 0.25,
        "spectrum_4px": 0.5,
        "spectrum_8px": 0.5,
        "line_recall": 9 / 40,
        "false_lines": 0.5,
        "residue": 0.1,
    }
    assert all(math.isnan(v) for v in detail_figures([]).values())


def test_residue_by_object(truth: Path) -> None:
    """Half of a car that is left; the other car is gone."""
    instances = np.zeros((HEIGHT, WIDTH), dtype=np.int64)
    instances[60:200, 120:220], instances[60:200, 220:320] = 4, 9
    clean = road()
    clean[60:130, 120:220] = RED
    street = detail(truth, removed=region())
    found = street.residue_by_object(street.compare(clean).residue, instances)
    assert set(found) == {4, 9}
    assert found[4][1] == found[9][1] == 140 * 100
    assert found[4][0] / found[4][1] == pytest.approx(0.5, abs=0.05)
    assert found[9][0] == 0
    assert street.residue_by_object(street.compare(clean).residue, np.zeros_like(instances)) == {}
