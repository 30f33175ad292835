"""A run opens its drive once, and lets go of it."""

from __future__ import annotations

from pathlib import Path

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.drive_options import DriveOptions
from unveil_core.pipeline.outside import let_go, opened, opened_once


def test_a_drive_is_read_once_where_it_is_asked_for_so_and_anew_where_it_is_not(tmp_path: Path) -> None:
    path, options = make_tiny_drive(tmp_path), DriveOptions()
    with opened_once():
        first = opened(path, options)
        assert opened(str(path), DriveOptions()) is first
        assert opened(path, DriveOptions(frames="0:1")) is not first
        let_go()
        assert opened(path, options) is not first
    with opened_once():
        assert opened(path, options) is not first  # another run finds what lies there now
    assert opened(path, options) is not opened(path, options)
