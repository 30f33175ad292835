"""What was written in a folder is known by name; all else is somebody's."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.output.written import (
    RECORD,
    check_replaceable,
    check_writable,
    files_in,
    note_written,
    strangers,
    written_in,
)


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)


def test_what_was_noted_may_be_written_again_and_nothing_else(tmp_path: Path) -> None:
    check_writable(tmp_path / "new", ["rgb/0.png"], mend="move it")
    note_written(tmp_path, ["rgb/0.png", "rgb/1.png"])
    put(tmp_path, "rgb/0.png", "depth/0.png", "notes.txt")
    check_writable(tmp_path, ["rgb/0.png", "rgb/1.png", "rgb/2.png"], mend="move it")
    with pytest.raises(SettingsError, match=r"depth/0.png: Not written by Unveil, and so not replaced \(move it\)"):
        check_writable(tmp_path, ["rgb/0.png", "depth/0.png"], mend="move it")
    with pytest.raises(SettingsError, match=r"notes.txt: Not a folder, and a folder is to be written here"):
        check_writable(tmp_path, ["notes.txt/0.png"], mend="move it")
    os.symlink(tmp_path / "depth", tmp_path / "normal")
    with pytest.raises(SettingsError, match="normal: Not a folder"):
        check_writable(tmp_path, ["normal/1.png"], mend="move it")


def test_the_list_grows_and_forgets_what_is_gone(tmp_path: Path) -> None:
    assert written_in(tmp_path) is None
    put(tmp_path, "a", "b/c")
    note_written(tmp_path, ["a", "b/c"])
    (tmp_path / "a").unlink()
    note_written(tmp_path, ["d"])
    assert written_in(tmp_path) == {RECORD, "b/c", "d"}


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{", '{"files": ["a"]}', '{"generator": 3}', '{"generator": "unveiled", "files": ["a"]}', "[" * 100_000],
)
def test_a_record_of_another_program_lists_nothing(content: str, tmp_path: Path) -> None:
    (tmp_path / RECORD).write_text(content)
    put(tmp_path, "a")
    assert written_in(tmp_path) is None
    with pytest.raises(SettingsError, match="Not written by Unveil"):
        check_writable(tmp_path, ["b"], mend="move it")
    with pytest.raises(SettingsError, match="Not written by Unveil"):
        check_replaceable(tmp_path, written_in(tmp_path), mend="move it")


def test_a_record_through_a_link_is_none(tmp_path: Path) -> None:
    note_written(tmp_path / "real", ["a"])
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
