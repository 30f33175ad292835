"""Frames of a preview: those that are tried are read, with neighbours, and nothing beyond the drive."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blender_addon.formats.windows import chosen_pictures, windows
from unveil_core.base.drive_options import frame_numbers


@given(st.integers(1, 400), st.data())
def test_what_is_tried_is_read(count: int, data: st.DataObject) -> None:
    now = data.draw(st.integers(0, count - 1))
    chosen = chosen_pictures(now, count)
    assert chosen == [now]
    read = frame_numbers(windows(chosen, count), count)
    assert now in read and len(read) <= 13 and max(read) < count
    assert all(min(abs(i - c) for c in chosen) <= 12 for i in read)


@given(st.integers(0, 20), st.integers(1, 4), st.integers(20, 90), st.data())
def test_of_a_part_of_a_drive_the_same_frames(first: int, step: int, end: int, data: st.DataObject) -> None:
    part = f"{first}:{end}:{step}"
    imported = frame_numbers(part, 100)
    if not imported:
        return
    now = data.draw(st.integers(0, len(imported) - 1))
    chosen = chosen_pictures(now, len(imported))
    read = frame_numbers(windows(chosen, len(imported), part), 100)
    assert {imported[i] for i in chosen} <= set(read) <= set(imported)


def test_frames_that_are_asked_for() -> None:
    assert chosen_pictures(5, 50, [40, 3, 77]) == [3, 40]
    assert windows([3, 40], 50) == "1:16:2,28:50:2" and windows([0], 5) == "0:5:2"
    for part in ("-5:", "3,9", "1:2:3:4", "7"):
        with pytest.raises(ValueError, match="a preview can count on"):
            windows([0], 5, part)
