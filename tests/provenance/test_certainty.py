"""Certainty falls with every doubt, has the levels that are documented, and a right pixel is what the definition says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from docs.generate import ROOT
from unveil_core.inpaint.origin import CONTINUED, INVENTED, RELIT, SEEN_ELSEWHERE
from unveil_core.provenance.certainty import (
    CERTAIN,
    CERTAIN_RIGHT,
    MODELS,
    ORIGINAL_LEVEL,
    RIGHT_LEVELS,
    certainty_levels,
    expected_right,
    right_pixels,
)
from unveil_core.provenance.doubts import DOUBTS, MOST, UNIT_SHARE, find_doubts
from unveil_core.provenance.leftovers import Leftovers
from unveil_core.provenance.witnesses import Seen

KINDS = {"relit": RELIT, "seen_elsewhere": SEEN_ELSEWHERE, "continued": CONTINUED, "invented": INVENTED}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_no_doubt_makes_surer(kind: int) -> None:
    origin = np.full(5, kind, np.uint8)
    for k in range(len(DOUBTS)):
        doubts = np.full((5, len(DOUBTS)), 0.5, np.float32)
        doubts[:, k] = np.linspace(0, 4, 5)
        assert (np.diff(expected_right(origin, doubts)) <= 0).all()


def test_the_models_are_those_of_the_benchmark() -> None:
    found = json.loads((ROOT / "benchmarks/results/certainty.json").read_text())
    assert found["doubts"] == list(DOUBTS) and found["certain"] == CERTAIN
    assert {name: tuple(found["models"][name]) for name in KINDS} == {name: MODELS[k] for name, k in KINDS.items()}


def test_what_is_called_certain_is_as_often_right_behind_planted_cars_as_it_says() -> None:
    """On real drives, each predicted by a fit that has not seen it."""
    found = json.loads((ROOT / "benchmarks/results/certainty.json").read_text())
    real = found["mean"]["real"]
    assert real["drives"] >= 3 and abs(real["certain_right"] - CERTAIN_RIGHT) <= 0.02
    assert all(drive["certain_right"] >= CERTAIN_RIGHT - 0.025 for drive in found["not_fitted_on"].values())


def test_what_no_frame_shows_is_never_certain() -> None:
    origin = np.array([SEEN_ELSEWHERE, CONTINUED, INVENTED], np.uint8)
    sure = certainty_levels(expected_right(origin, np.zeros((3, len(DOUBTS)), np.float32)))
    assert (sure >= CERTAIN).tolist() == [True, False, False]


def test_nothing_that_was_made_is_as_sure_as_the_photograph() -> None:
    assert certainty_levels(np.array([0, 0.5, 1], np.float32)).tolist() == [0, 127, 254] and ORIGINAL_LEVEL == 255


def test_right_is_less_than_the_levels_away() -> None:
    truth = np.full((20, 40, 3), 100, np.uint8)
    delivered = truth.copy()
    delivered[:, :20] += int(RIGHT_LEVELS) + 1
    right = right_pixels(delivered, truth)
    assert not right[:, :15].any() and right[:, 25:].all()


def test_doubts_of_a_picture_that_is_known() -> None:
    """A grey frame with a hole of 7 rows that was filled 24 levels brighter than what is beside it."""
    photograph = np.full((41, 384, 3), 100, np.uint8)
    changed = np.zeros((41, 384), dtype=bool)
    changed[17:24] = True
    delivered = np.where(changed[..., None], 124, photograph).astype(np.uint8)
    depth = np.full((41, 384), 7.0, np.float32)
    depth[:20] = 0
    count = int(changed.sum())
    seen = Seen(
        np.where(np.arange(count) % 2, 3, 0).astype(np.float32),
        np.full((count, 3), 112.0, np.float32),
        np.zeros(count, np.float32),
    )
    left = Leftovers(np.full(count, 0.5, np.float32), np.full(count, 0.75, np.float32))
    found = find_doubts(delivered, photograph, (delivered, photograph), changed, ~changed, depth, seen, left)
    planes = dict(zip(DOUBTS, found.reshape(7, 384, -1).transpose(2, 0, 1), strict=True))
    middle = {name: plane[3, 100:102] for name, plane in planes.items()}
    assert middle["inside"] == pytest.approx(np.log2(5), abs=0.05) and middle["distance"] == pytest.approx(3)
    assert (planes["distance"][0] > 6).all() and (planes["inside"][3] > planes["inside"][0]).all()
    assert middle["beside"] == pytest.approx(MOST) and middle["refitted"] == pytest.approx(MOST)
    assert middle["changed"] == pytest.approx(0)
    assert middle["unseen"] == pytest.approx([1, 0.25]) and middle["contradicted"] == pytest.approx([0, 1], abs=0.05)
    assert middle["darker"] == pytest.approx(0.5 / UNIT_SHARE) and middle["near"] == pytest.approx(0.75)
