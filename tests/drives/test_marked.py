"""Folders of mattes: which of their files are pictures, and one that is no such folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives import marked
from unveil_core.drives.marked import files_named, read_marked


def test_pictures_are_found_in_sub_folders_in_order(tmp_path: Path) -> None:
    for name in ("b.png", "a.JPG", "front/c.tif", "notes.txt", ".hidden.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    assert [p.relative_to(tmp_path).as_posix() for p in files_named(tmp_path)] == ["a.JPG", "b.png", "front/c.tif"]


def test_numbers_in_names_count_as_numbers(tmp_path: Path) -> None:
    for k in (1, 2, 10):
        (tmp_path / f"matte{k}.png").write_bytes(b"")
    assert [p.stem for p in files_named(tmp_path)] == ["matte1", "matte2", "matte10"]


def test_a_disk_is_no_folder_of_mattes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(marked, "MOST_FILES", 50)
    for k in range(51):
        (tmp_path / f"{k}.png").write_bytes(b"")
    path = tmp_path / "marked.json"
    path.write_text(json.dumps([{"id": 7, "mattes": str(tmp_path)}]))
    with pytest.raises(DriveError, match="holds more than 50 files"):
        read_marked(path)
