"""Rows of large JSON tables: as json reads them, whatever stands in their strings, and wherever a file is cut."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.nuscenes import json_rows as module
from unveil_core.drives.formats.nuscenes.json_rows import json_rows

NASTY = ['},{"token": "x"', "}, {", '"},{"a', "\\", '\\"', "] }", "é ☃", '{"scene": "b"}', "", "},\n{\n"]


def rows_of(count: int) -> list[dict[str, object]]:
    generator = np.random.default_rng(0)
    return [
        {
            "token": f"{i:032x}",
            "scene": "abc"[i % 3],
            "text": "".join(generator.choice(NASTY, 3)),
            "size": [1.5, -2e-7, 3],
            "last": None if i % 2 else NASTY[i % len(NASTY)],
        }
        for i in range(count)
    ]


@pytest.mark.parametrize("layout", [{"indent": 0}, {"indent": 2}, {"separators": (",", ":")}, {"ensure_ascii": False}])
@pytest.mark.parametrize("chunk", [7, 100, 1 << 20])
def test_rows_are_those_of_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int, layout: dict[str, object]
) -> None:
    rows = rows_of(40)
    path = tmp_path / "table.json"
    path.write_text(json.dumps(rows, **layout), encoding="utf-8")  # type: ignore[arg-type]
    monkeypatch.setattr(module, "CHUNK_BYTES", chunk)
    assert list(json_rows(path)) == rows
    assert list(json_rows(path, "scene", {"b"})) == [r for r in rows if r["scene"] == "b"]
    assert list(json_rows(path, "scene", {"d"})) == []


@pytest.mark.parametrize("text", ["[]", " [ \n ] \n"])
def test_an_empty_table_has_no_rows(tmp_path: Path, text: str) -> None:
    path = tmp_path / "table.json"
    path.write_text(text)
    assert list(json_rows(path)) == []


def test_a_table_that_is_cut_anywhere_is_refused(tmp_path: Path) -> None:
    text = json.dumps(rows_of(3), indent=1)
    path = tmp_path / "table.json"
    for length in range(len(text)):
        path.write_text(text[:length])
        with pytest.raises(DriveError, match="Cut short|Not a list"):
            list(json_rows(path, "scene", {"-"}))


@pytest.mark.parametrize("text", ["", "{}", '{"a": 1}', "nothing", "[1, 2]", '["a"]'])
def test_what_is_no_list_of_objects_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "table.json"
    path.write_text(text)
    with pytest.raises(DriveError):
        list(json_rows(path))


def test_a_damaged_row_is_refused_where_it_is_looked_for(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    path.write_text('[{"scene": "a", "x": 1}, {"scene": "b", "x": }, {"scene": "c"}]')
    assert list(json_rows(path, "scene", {"a", "c"})) == [{"scene": "a", "x": 1}, {"scene": "c"}]
    with pytest.raises(DriveError, match="Not valid JSON in a row"):
        list(json_rows(path, "scene", {"b"}))


def test_what_has_no_end_does_not_fill_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CHUNK_BYTES", 64)
    monkeypatch.setattr(module, "MOST_BYTES_OF_A_ROW", 256)
    path = tmp_path / "table.json"
    path.write_text('[{"a": "' + "x" * 10_000)
    with pytest.raises(DriveError, match="without an end"):
        list(json_rows(path))


def test_a_missing_table_says_so(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=r"none\.json: cannot be read"):
        list(json_rows(tmp_path / "none.json"))
