"""Bay lines that cars hide in part or altogether."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.inpaint.fill.transverse_markings import continue_transverse_markings

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
    found, share = continue_transverse_markings(
        np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M
    )
    hidden, where = line & ~known, share > 0.5
    assert where[hidden].mean() > 0.75
    assert (where & ~line).sum() < 0.7 * hidden.sum(), "a row or two thicker at most"
    assert np.abs(found[where & line] - 0.3).max() < 0.05
    assert not found[share == 0].any() and not share[known].any() and share.max() <= 1


def test_a_side_that_hides_most_of_its_lines_is_divided_like_the_other() -> None:
    detail, line = parking_lane()
    known = np.ones_like(line)
    for row in range(60 + 140, 1400, 280):
        known[row - 30 : row + 33, 35:95] = False
    _, share = continue_transverse_markings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    assert (share > 0.5)[line & ~known].mean() > 0.75


def test_the_distance_that_supposes_least_is_taken() -> None:
    """Lines at 0, 2 and 4 periods, all between them hidden: nothing says that there are lines at a third of that distance,
    though marks farther aside stand so."""
    detail, line = parking_lane()
    detail = np.where(line[..., None] & (np.arange(260) >= 160)[None, :, None], 0, detail).astype(np.float32)
    for row in range(60, 1390, 93):  # two thirds of the bays' distance
        detail[row : row + 3, 225:255] = 0.3
    known = np.ones_like(line)
    for row in (200, 340, 480, 620, 760):
        known[row - 60 : row - 5, 35:95] = False
    known[200 - 30 : 200 + 33, 35:95] = known[480 - 30 : 480 + 33, 35:95] = False
    _, share = continue_transverse_markings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    lane = share[:, BAY] > 0.5
    off = np.ones(len(lane), dtype=bool)
    for row in range(60, 1390, 140):
        off[row - 6 : row + 9] = False
    assert not lane[off].any()
    assert lane[200:203].mean() > 0.75 and lane[480:483].mean() > 0.75


@pytest.mark.parametrize("seen", ["nothing", "everything", "no line"])
def test_nothing_is_made_up(seen: str) -> None:
    detail, line = parking_lane()
    if seen == "no line":
        detail = np.where(line[..., None], 0, detail)
    known = np.full_like(line, seen != "nothing")
    if seen == "no line":
        known[200:400, 30:100] = False
    _, where = continue_transverse_markings(detail, known, ~known, texels_per_m=PER_M)
    assert not where.any()


def test_a_single_manhole_is_not_repeated() -> None:
    detail, line = parking_lane()
    detail = np.where(line[..., None], 0, detail)
    detail[300:312, 120:132] += 0.3
    known = np.ones_like(line)
    known[500:600] = False
    known[300:312, 126:160] = False
    _, where = continue_transverse_markings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    assert not where.any()


@pytest.mark.parametrize("ends", [False, True])
def test_bays_of_which_only_tips_are_seen_are_as_deep_as_those_across(ends: bool) -> None:
    """A row of cars hides all but the last 80 cm of the left lines; where two of them are seen to end there, all do."""
    detail, line = parking_lane()
    known = np.ones_like(line)
    known[:, :70] = False
    if ends:
        known[:, 60:] = True
        line[:, :70] = False
        detail[:, :70] = 0
    _, share = continue_transverse_markings(np.where(known[..., None], detail, 0), known, ~known, texels_per_m=PER_M)
    if ends:
        assert not share.any()
        return
    hidden = line & ~known
    assert (share > 0.5)[hidden].mean() > 0.75
    assert not share[:, :30].any(), "no deeper"


def test_beyond_a_corner_a_row_of_bays_begins_anew() -> None:
    """Bays as long, but elsewhere; on each street three lines of six are seen, by which alone nobody would tell."""
    detail, line = parking_lane(rows=2000)
    detail[:, 160:], line[:, 160:] = 0, False
    corner = slice(900, 1040)
    detail[corner], line[corner] = 0, False
    detail[1040:], line[1040:] = np.roll(detail[1040:], 75, axis=0), np.roll(line[1040:], 75, axis=0)
    known, rows = np.ones_like(line), np.flatnonzero(line[:, 60] & ~np.roll(line[:, 60], 1))
    before, after = rows[rows < 900], rows[rows > 1040]
    for row in (*before[[1, 2, 4]], *after[[1, 3, 4]]):
        known[row - 30 : row + 33, 35:95] = False
    given = np.where(known[..., None], detail, 0)
    streets = (slice(0, 900), slice(1040, 2000))
    _, share = continue_transverse_markings(given, known, ~known, texels_per_m=PER_M, streets=streets)
    assert (share > 0.5)[line & ~known].mean() > 0.75
    assert ((share > 0.5) & ~line).sum() < 0.7 * (line & ~known).sum()
    _, as_one = continue_transverse_markings(given, known, ~known, texels_per_m=PER_M)
    assert not (as_one > 0.5)[1040:].any()
