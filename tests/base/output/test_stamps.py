"""A file is as it was written by its size and time, or by its content."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from unveil_core.base.output.stamps import is_unchanged, stamp_of


def test_a_file_that_was_touched_copied_or_changed(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"street")
    held = stamp_of(file)
    assert is_unchanged(file, held)
    os.utime(file, ns=(0, 0))
    assert is_unchanged(file, held)
    shutil.copyfile(file, tmp_path / "b")
    assert is_unchanged(tmp_path / "b", held)
    file.write_bytes(b"strEet")
    assert not is_unchanged(file, held)
    assert not is_unchanged(tmp_path / "gone", held)


def test_what_is_no_stamp_tells_of_no_file(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"")
    assert not any(is_unchanged(file, held) for held in (None, 3, [], [0], ["", "", ""], {}))


def test_a_link_is_no_file_that_was_written(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"key")
    held = stamp_of(tmp_path / "secret")
    (tmp_path / "link").symlink_to(tmp_path / "secret")
    assert not is_unchanged(tmp_path / "link", held)
