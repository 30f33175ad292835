"""Names of files, whatever a stranger's file says."""

from __future__ import annotations

import unicodedata
from pathlib import PurePosixPath, PureWindowsPath

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from unveil_core.base.checks.names import LONGEST_BYTES, distinct_file_names, file_name, is_file_name, name_key

DEVICES = ["COM¹", "lpt³.png", "CONIN$", "conout$.txt", "con .txt", "nul  ", "Aux b", "LPT0"]
UNSEEN = ["a\u200fb", "a\u2028b", "a\u2029b", "a\u202eb", "a\u2060", "\ufeffa", "a\udcff", "a\x85b", "a\u00adb"]


@given(st.text())
@example("COM\u00b9")
@example("conin$ .x")
@example("a\u200fb\u2028")
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


@pytest.mark.parametrize(
    "text", ["", ".", "..", "a/b", "a\\b", " a", "con", "Aux.png", "x:y", 7, None, *DEVICES, *UNSEEN]
)
def test_what_is_none_is_told(text: object) -> None:
    assert not is_file_name(text)


@given(st.lists(st.text(max_size=5), max_size=8))
def test_different_texts_have_different_names(texts: list[str]) -> None:
    names = distinct_file_names(texts)
    assert set(names) == set(texts) and all(is_file_name(n) for n in names.values())
    for form in ("NFC", "NFD"):
        written = [unicodedata.normalize(form, n) for n in names.values()]
        assert len({n.casefold() for n in written}) == len({n.upper() for n in written}) == len(names)


def test_what_some_system_takes_for_one_is_told_apart() -> None:
    texts = ["cafe\u0301", "caf\u00e9", "CAFE\u0301", "stra\u00dfe", "STRASSE", "\u212b", "\u00c5", "i", "\u0131"]
    names = distinct_file_names(texts)
    assert len(set(map(name_key, names.values()))) == len(texts) and names["cafe\u0301"] == "cafe\u0301"


def test_who_has_a_name_keeps_it() -> None:
    assert distinct_file_names(["a/b", "a_b", "A_B"]) == {"a_b": "a_b", "A_B": "A_B_2", "a/b": "a_b_3"}
