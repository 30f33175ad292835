"""What counts as a line, and when one is found, missed or false."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.evaluate.detail.pictures import ASPHALT, HEIGHT, WIDTH, blurred, grained, road
from unveil_core.evaluate.detail.lines import find_edges, match_lines


def recall_and_false(truth: np.ndarray, ours: np.ndarray, where: np.ndarray | None = None) -> tuple[float, float]:
    where = np.ones(truth.shape[:2], dtype=bool) if where is None else where
    match = match_lines(find_edges(truth), find_edges(ours), where)
    true, made = match.found.sum() + match.missed.sum(), match.right.sum() + match.false.sum()
    return match.found.sum() / max(true, 1), match.false.sum() / max(made, 1)


def test_equal_pictures() -> None:
    assert find_edges(road()).line.sum() > 400  # both edges of a line as high as the picture
    assert recall_and_false(road(), road()) == (1.0, 0.0)


def test_a_blurred_line_is_lost_and_a_soft_one_is_not() -> None:
    assert recall_and_false(road(), blurred(road(), 0.8)) == (1.0, 0.0)
    recall, _ = recall_and_false(road(), blurred(road(), 3.0))
    assert recall < 0.05


def test_a_faded_line_is_lost() -> None:
    assert recall_and_false(road(), road(paint=170))[0] == 1.0
    assert recall_and_false(road(), road(paint=140))[0] == 0.0


@pytest.mark.parametrize("width", [3.0, 4.0, 5.0, 6.0])
def test_a_moved_line_is_missed_and_false(width: float) -> None:
    """Also where one of its edges comes to lie where the other was."""
    assert recall_and_false(road(width=width), road(width=width, shift=1.0)) == (1.0, 0.0)
    assert recall_and_false(road(width=width), road(width=width, shift=5.0)) == (0.0, 1.0)


def test_a_doubled_line_is_false() -> None:
    doubled = np.maximum(road(), road(shift=12.0))
    recall, false = recall_and_false(road(), doubled)
    assert recall == 1.0
    assert false == pytest.approx(0.5, abs=0.02)
    assert recall_and_false(doubled, road()) == (pytest.approx(0.5, abs=0.02), 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_grain_makes_no_lines(seed: int) -> None:
    flat = np.full((HEIGHT, WIDTH, 3), ASPHALT, dtype=np.uint8)
    assert not find_edges(grained(flat, 2.0, seed)).line.any()
    recall, false = recall_and_false(road(), grained(road(), 2.0, seed))
    assert recall > 0.99 and false == 0.0
    assert recall_and_false(grained(road(), 2.0, seed), road()) == (pytest.approx(1.0, abs=0.01), 0.0)


def test_a_crossing_line_of_another_direction_finds_nothing() -> None:
    turned = np.ascontiguousarray(road()[:, ::-1])
    recall, false = recall_and_false(road(), turned)
    assert recall < 0.05 and false > 0.95


def test_dark_for_bright_is_not_found() -> None:
    recall, false = recall_and_false(road(), 2 * ASPHALT - np.minimum(road(), 2 * ASPHALT - 1))
    assert recall == 0.0 and false == 1.0


def test_short_pieces_are_no_lines() -> None:
    flat = np.full((HEIGHT, WIDTH, 3), ASPHALT, dtype=np.uint8)
    dash, line = flat.copy(), flat.copy()
    cv2.line(dash, (100, 100), (106, 100), (200, 200, 200), 2)
    cv2.line(line, (100, 100), (125, 100), (200, 200, 200), 2)
    assert not find_edges(dash).line.any()
    assert find_edges(line).line.any()


def test_only_pixels_asked_for_count() -> None:
    where = np.zeros((HEIGHT, WIDTH), dtype=bool)
    where[: HEIGHT // 2] = True
    match = match_lines(find_edges(road()), find_edges(road(shift=5.0)), where)
    assert match.missed.any() and match.false.any()
    assert not (match.missed | match.false)[HEIGHT // 2 :].any()


def test_borders_grow_with_the_picture() -> None:
    """Four times as large, the same street is judged alike: half a pixel aside is 2, 5 are 20."""
    large = road(scale=4)
    assert recall_and_false(large, road(scale=4, shift=0.5)) == (1.0, 0.0)
    assert recall_and_false(large, road(scale=4, shift=5.0)) == (0.0, 1.0)
