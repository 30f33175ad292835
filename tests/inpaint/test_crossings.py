"""Bay lines that cars hide in part or altogether."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.inpaint.crossings import continue_crossings

PER_M = 25.0
BAY = slice(40, 90)


def parking_lane(rows: int = 1500, period: int = 140, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Detail (A, B, 3) of a street with bay lines every ``period`` rows on its left and right, and where they lie (A, B)."""
    rng = np.random.default_rng(seed)
    line = np.zeros((rows, 260), dtype=bool)
    for row in range(60, rows - 10, period):
        line[row : row + 3, BAY] = True
        line[row + 40 : row + 43, 170:220] = True
    detail = rng.normal(0, 0.015, (*line.shape, 1)).repeat(3, axis=2) + 0.3 * line[..., None]
    return detail.astype(np.float32), line


def test_stubs_go_on_and_hidden_lines_stand_where_the_others_say() -> None:
    detail, line = parking_lane()
    known = np.ones_like(line)
    for row in (180, 460, 600, 880):  # cars, each over one line; of the second a stub is seen
        known[row : row + 60, 35:95] = False
    known[460:520, 35:55] = True
    found, where = continue_crossings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    hidden = line & ~known
    assert where[hidden].mean() > 0.75
    assert (where & ~line).sum() < 0.7 * hidden.sum(), "a row or two thicker at most"
    assert np.abs(found[where & line] - 0.3).max() < 0.05
    assert not found[~where].any() and not where[known].any()


def test_a_side_that_hides_most_of_its_lines_is_divided_like_the_other() -> None:
    detail, line = parking_lane()
    known = np.ones_like(line)
    for row in range(60 + 140, 1400, 280):
        known[row - 30 : row + 33, 35:95] = False
    _, where = continue_crossings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    assert where[line & ~known].mean() > 0.75


@pytest.mark.parametrize("seen", ["nothing", "everything", "no line"])
def test_nothing_is_made_up(seen: str) -> None:
    detail, line = parking_lane()
    if seen == "no line":
        detail = np.where(line[..., None], 0, detail)
    known = np.full_like(line, seen != "nothing")
    if seen == "no line":
        known[200:400, 30:100] = False
    _, where = continue_crossings(detail, known, ~known, texels_per_m=PER_M)
    assert not where.any()


def test_a_single_manhole_is_not_repeated() -> None:
    detail, line = parking_lane()
    detail = np.where(line[..., None], 0, detail)
    detail[300:312, 120:132] += 0.3
    known = np.ones_like(line)
    known[500:600] = False
    known[300:312, 126:160] = False
    _, where = continue_crossings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    assert not where.any()
