"""Names of files, whatever a stranger's file says."""

from __future__ import annotations

from pathlib import PurePosixPath, PureWindowsPath

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from unveil_core.base.checks.names import LONGEST_BYTES, distinct_file_names, file_name, is_file_name


@given(st.text())
@example("../../../home/x")
@example("C:\\Windows")
@example("nul.png")
@example("a" * 300)
@example("\u00e4" * 200)
@example("\ud800")
@example(". .")
def test_a_name_is_one_visible_file_s_on_any_system(text: str) -> None:
    name = file_name(text)
    assert is_file_name(name) and file_name(name) == name
    for kind in (PurePosixPath, PureWindowsPath):
        path = kind("folder") / name
        assert path.parts == ("folder", name) and path.suffix == kind(name).suffix
    assert not name.startswith(".") and not name.endswith((".", " ")) and "\0" not in name
    assert len(name.encode()) <= LONGEST_BYTES


@pytest.mark.parametrize("text", ["front", "0001", "image 07 (copy)", "Stra\u00dfe_1", "a.b-c", "\u524d"])
def test_what_is_a_name_stays(text: str) -> None:
    assert file_name(text) == text and is_file_name(text)


@pytest.mark.parametrize("text", ["", ".", "..", "a/b", "a\\b", " a", "con", "Aux.png", "x:y", 7, None])
def test_what_is_none_is_told(text: object) -> None:
    assert not is_file_name(text)


@given(st.lists(st.text(max_size=5), max_size=8))
def test_different_texts_have_different_names(texts: list[str]) -> None:
    names = distinct_file_names(texts)
    assert set(names) == set(texts) and all(is_file_name(n) for n in names.values())
    assert len({n.casefold() for n in names.values()}) == len(names)


def test_who_has_a_name_keeps_it() -> None:
    assert distinct_file_names(["a/b", "a_b", "A_B"]) == {"a_b": "a_b", "A_B": "A_B_2", "a/b": "a_b_3"}
