"""Programs are found in absolute folders of PATH alone."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from unveil_core.base.surroundings.programs import program

pytestmark = pytest.mark.skipif(os.name == "nt", reason="makes a program by its mode")


def test_a_program_of_the_working_folder_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "tool").write_text("#!/bin/sh\n")
        (tmp_path / folder / "tool").chmod(0o755)
    monkeypatch.chdir(tmp_path / "here")
    for path in (".", "", f":{tmp_path / 'no'}", "../here"):
        monkeypatch.setenv("PATH", path)
        assert program("tool") is None
    monkeypatch.setenv("PATH", f".:{tmp_path / 'there'}")
    assert program("tool") == str(tmp_path / "there/tool")
