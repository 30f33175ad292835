"""The add-on's files: written whole or not at all, also where another program holds them."""

from __future__ import annotations

import errno
import os
import time
from pathlib import Path

import pytest

from blender_addon.formats.files import copied, file_stamp, files_stamp, write_whole


class Holder:
    """Another program that holds a file for so many attempts to rename it."""

    def __init__(self, times: int, winerror: int | None = 32) -> None:
        self.times, self.winerror, self.real = times, winerror, os.replace

    def __call__(self, source: object, target: object) -> None:
        if self.times:
            self.times -= 1
            error = PermissionError(errno.EACCES, "held")
            if self.winerror is not None:
                error.winerror = self.winerror  # type: ignore[attr-defined]
            raise error
        self.real(source, target)  # type: ignore[arg-type]


def test_a_rename_waits_for_who_holds_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "replace", Holder(3))
    write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"new"
    monkeypatch.setattr(os, "replace", Holder(2, 5))
    copied(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_bytes() == b"new" and len(list(tmp_path.iterdir())) == 2


def test_it_does_not_wait_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("old")
    for times, winerror, longest in ((1000, 32, 10.0), (1, None, 0.5)):
        monkeypatch.setattr(os, "replace", Holder(times, winerror))
        begun = time.monotonic()
        with pytest.raises(PermissionError):
            write_whole(tmp_path / "a", b"new")
        assert time.monotonic() - begun < longest
        assert [p.name for p in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_text() == "old"


def test_a_name_may_be_as_long_as_the_system_allows(tmp_path: Path) -> None:
    write_whole(tmp_path / ("x" * 251 + ".obj"), b"content")
    assert [p.name for p in tmp_path.iterdir()] == ["x" * 251 + ".obj"]


def test_a_stamp_is_another_when_a_file_is_written_anew(tmp_path: Path) -> None:
    paths = [tmp_path / "a", tmp_path / "b"]
    assert file_stamp(paths[0]) == ""
    found = {files_stamp(paths)}
    for path, content in zip([*paths, paths[0]], ("1", "2", "22"), strict=True):
        path.write_text(content)
        assert file_stamp(path).startswith(f"{len(content)} ")
        found.add(files_stamp(paths))
    os.utime(paths[0], ns=(0, 5))
    assert len(found | {files_stamp(paths)}) == 5 and file_stamp(paths[0]) == "2 5"
    assert files_stamp(paths) == files_stamp(iter(paths))
