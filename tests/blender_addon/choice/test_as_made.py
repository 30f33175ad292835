"""A choice keeps the words of the workspace that it was made in, as long as it is the same choice."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from blender_addon.choice.as_made import file_elsewhere, in_its_words, remembered

WORDS = ["--remove", "car,truck", "--per-object", "3:grow=4,3:shadow=keep"]


def test_the_workspace_s_own_words_come_back() -> None:
    recorded = {"remove": ["vehicle"], "instances": [3, 7], "per_object": ["3:shadow=keep", "3:grow=4"]}
    kept = remembered(WORDS, recorded)
    own = ["--remove", "vehicle", "--instances", "3,7", "--per-object", "3:shadow=keep,3:grow=4"]
    assert in_its_words(WORDS, kept) == own
    changed = ["--remove", "car", *WORDS[2:]]
    assert in_its_words(changed, kept) == changed
    assert in_its_words([], remembered([], {"remove": [], "instances": [], "per_object": []})) == []


@pytest.mark.parametrize("recorded", [{}, {"remove": "car"}, {"remove": [3], "instances": [], "per_object": []}])
def test_what_a_stranger_s_workspace_tells_wrongly_is_left(recorded: dict[str, object]) -> None:
    assert remembered(WORDS, recorded) == ""


@pytest.mark.parametrize("kept", ["", "{", "[]", "3", json.dumps({"words": WORDS, "own": 3})])
def test_what_a_stranger_s_blend_tells_wrongly_is_left(kept: str) -> None:
    assert in_its_words(WORDS, kept) == WORDS


def test_a_file_elsewhere_counts_where_the_workspace_has_none_of_its_own(tmp_path: Path) -> None:
    own, other = tmp_path / "ws/marked.json", tmp_path / "farm/m.json"
    for path in (own, other):
        path.parent.mkdir()
    other.write_text("[]")
    assert file_elsewhere(own.parent, {"marked": str(other)}, "marked") == str(other)
    for told in ({}, {"marked": None}, {"marked": 3}, {"marked": str(tmp_path / "gone.json")}):
        assert file_elsewhere(own.parent, told, "marked") == ""
    own.write_text("[]")
    assert file_elsewhere(own.parent, {"marked": str(other)}, "marked") == ""
