"""Frames by doubt, as a workspace's figures tell it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from blender_addon.formats.figures.doubts import read_doubts


def write(folder: Path, content: object) -> Path:
    (folder / "metrics.json").write_text(json.dumps(content))
    return folder


def frame(name: str, made_up: object, removed: object = 900) -> dict[str, object]:
    return {"camera": "front", "frame": name, "unobserved_pixels": made_up, "removed_pixels": removed}


def test_the_worst_comes_first_and_what_is_certain_is_left_out(tmp_path: Path) -> None:
    told = {"removed": 0.25, "seen_elsewhere_of_removed": 0.6}
    content = {"per_frame": [frame("a", 10), frame("b", 500), frame("c", 0), frame("d", 10)], "coverage": told}
    found = read_doubts(write(tmp_path, content))
    assert [f.name for f in found.worst_first()] == ["b", "a", "d"] and len(found.frames) == 4
    assert (found.removed, found.seen) == (0.25, 0.6)


def test_before_the_report_nothing_is_told(tmp_path: Path) -> None:
    found = read_doubts(tmp_path)
    assert (found.frames, found.removed, found.seen) == ((), None, None)


@pytest.mark.parametrize(
    "content",
    [
        [],
        {"per_frame": [frame("../../etc", 1)]},
        {"per_frame": [frame("a", -1)]},
        {"per_frame": [frame("a", "many")]},
        {"per_frame": [{"camera": "front"}]},
        {"per_frame": [], "coverage": {"removed": 7}},
    ],
)
def test_what_is_damaged_is_one_line_that_names_the_file(tmp_path: Path, content: object) -> None:
    with pytest.raises(ValueError, match=r"metrics\.json: Damaged: .*run the stage Report again"):
        read_doubts(write(tmp_path, content))
