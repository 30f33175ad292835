"""Known holes end `make lint`; nothing that could be looked up does not."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import pytest

from requirements.audit import judged, main

SOUND = {"name": "numpy", "version": "2.4.4", "vulns": []}
HOLE = {"name": "pillow", "version": "9.0.0", "vulns": [{"id": "CVE-2022-22817", "fix_versions": ["9.0.1"]}]}
UNKNOWN = {"name": "bpy", "skip_reason": "Dependency not found"}


def test_a_known_hole_is_told_with_its_mend() -> None:
    code, lines = judged([SOUND, HOLE, UNKNOWN])
    assert code == 1 and lines == ["pillow 9.0.0: CVE-2022-22817, mended in 9.0.1"]


def test_packages_that_no_one_knows_do_not_count_as_sound() -> None:
    assert judged([SOUND, UNKNOWN]) == (
        0,
        ["no holes are known in 1 packages; 1 are not known there"],
    )
    code, (line,) = judged([UNKNOWN] * 3)
    assert code == 0 and line.startswith("nothing was looked up")


@pytest.mark.skipif(sys.platform == "win32", reason="a script of a shell")
@pytest.mark.parametrize("script", [None, "exit 1", "echo no JSON", "echo '{}'"])
def test_without_a_network_one_line_says_so(
    script: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "pip-audit"
    if script is not None:
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(stat.S_IRWXU)
    assert main([str(program)]) == 0
    assert capsys.readouterr().out.splitlines()[0].startswith("known holes: nothing was looked up")
