"""What was written in a folder is known by name; all else is somebody's."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.output.written import (
    GENERATOR,
    RECORD,
    check_replaceable,
    files_in,
    strangers,
    written_in,
)


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{", '{"files": ["a"]}', '{"generator": 3}', '{"generator": "unveiled", "files": ["a"]}', "[" * 100_000],
)
def test_a_record_of_another_program_lists_nothing(content: str, tmp_path: Path) -> None:
    (tmp_path / RECORD).write_text(content)
    put(tmp_path, "a")
    assert written_in(tmp_path) is None
    with pytest.raises(SettingsError, match="Not written by Unveil"), OwnFolder(tmp_path):
        pass
    with pytest.raises(SettingsError, match="Not written by Unveil"):
        check_replaceable(tmp_path, written_in(tmp_path), mend="move it")


def test_a_record_through_a_link_is_none(tmp_path: Path) -> None:
    put(tmp_path / "real", "a")
    write_json_atomic(tmp_path / "real" / RECORD, {"generator": GENERATOR, "files": ["a"]})
    assert written_in(tmp_path / "real") == {RECORD, "a"}
    (tmp_path / "other").mkdir()
    os.symlink(tmp_path / "real" / RECORD, tmp_path / "other" / RECORD)
    assert written_in(tmp_path / "other") is None


def test_a_folder_is_replaced_where_nothing_else_is_in_it(tmp_path: Path) -> None:
    folder = tmp_path / "made"
    check_replaceable(folder, None, mend="move it")
    folder.mkdir()
    check_replaceable(folder, None, mend="move it")
    put(folder, "a", "b/c", ".DS_Store", "b/Thumbs.db")
    check_replaceable(folder, ["a", "b/c"], mend="move it")
    for stranger in ("b/mine.txt", "d/e/f.txt"):
        put(folder, stranger)
        with pytest.raises(DriveError, match=stranger.replace("/e/f.txt", ": Not written by Unveil")):
            check_replaceable(folder, ["a", "b/c"], mend="move it", kind=DriveError)
        (folder / stranger).unlink()
    assert [p.name for p in strangers(folder, ["a", "b/c"])] == ["d"]  # a folder that somebody made
    with pytest.raises(SettingsError, match="Not a folder"):
        check_replaceable(folder / "a", None, mend="move it")


def test_a_list_that_leads_out_of_the_folder_reaches_nothing_there(tmp_path: Path) -> None:
    put(tmp_path, "mine.txt", "made/a")
    record = {"generator": "unveil 0", "files": ["../mine.txt", "/etc/passwd", 3, "a"]}
    (tmp_path / "made" / RECORD).write_text(json.dumps(record))
    assert list(strangers(tmp_path / "made", written_in(tmp_path / "made") or ())) == []
    assert files_in(tmp_path / "made") == [RECORD, "a"]
