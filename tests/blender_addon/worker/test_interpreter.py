"""Finding the Python that has unveil_core, and saying what is wrong with another."""

from __future__ import annotations

import os
import sys
import venv
from pathlib import Path

import pytest

from blender_addon.worker.interpreter import Candidate, candidates, check, find, venv_python
from tests.blender_addon.run_in_blender import unveil_python

EMPTY: dict[str, str] = {}


def fake(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\nexit 3\n")
    path.chmod(0o755)
    return path


def test_the_usual_places_in_their_order(tmp_path: Path) -> None:
    variable = fake(tmp_path / "variable/python")
    own = fake(venv_python(tmp_path / "own"))
    of_script = fake(tmp_path / "tool/python3.11")
    command = fake(tmp_path / "bin/unveil")
    command.write_text(f"#!{of_script}\n")
    active = fake(venv_python(tmp_path / "active"))
    on_path = fake(tmp_path / "bin/python3")
    environ = {"UNVEIL_PYTHON": str(variable), "PATH": str(tmp_path / "bin"), "VIRTUAL_ENV": str(tmp_path / "active")}
    found = candidates(own=own, environ=environ)
    assert [c.python for c in found] == [variable, own, of_script, active, on_path]
    assert found[0].source == "from UNVEIL_PYTHON" and found[3].source == "from VIRTUAL_ENV"


def test_what_lies_in_the_working_folder_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive and a .blend come from strangers, and Blender's working folder may be theirs."""
    for name in (".venv", "venv", "."):
        fake(venv_python(tmp_path / "street" / name))
    (tmp_path / "street/drive").mkdir()
    monkeypatch.chdir(tmp_path / "street/drive")
    assert candidates(environ={}) == []
    for name in ("unveil", "python3"):
        fake(tmp_path / "street/drive" / name)
    assert candidates(environ={"PATH": os.pathsep.join((".", "", str(tmp_path / "none")))}) == []


def test_who_names_one_gets_that_one(tmp_path: Path) -> None:
    named = fake(venv_python(tmp_path / "mine"))
    environ = {"UNVEIL_PYTHON": str(fake(tmp_path / "other"))}
    assert [c.python for c in candidates(str(named), environ=environ)] == [named]
    assert [c.python for c in candidates(str(tmp_path / "mine"), environ=environ)] == [
        named
    ]  # the environment's folder
    assert candidates(str(tmp_path / "nowhere"), environ=environ) == []


def test_each_once_and_links_are_kept(tmp_path: Path) -> None:
    real = fake(tmp_path / "real/python3")
    link = venv_python(tmp_path / "env")
    link.parent.mkdir(parents=True)
    link.symlink_to(real)
    environ = {"UNVEIL_PYTHON": str(link), "VIRTUAL_ENV": str(tmp_path / "env")}
    assert [c.python for c in candidates(environ=environ)] == [link]


def test_this_one_has_everything(tmp_path: Path) -> None:
    found = check(Candidate(unveil_python(tmp_path), "of the tests"))
    assert found.ok and not found.problem, found
    lines = found.lines()
    assert lines[1].startswith("unveil ") and "torch" in lines[1]
    assert "CPU cores" in lines[2] and "GPU:" in lines[2] and lines[-1] == "Ready."


def test_what_is_wrong_is_one_line_with_its_mend(tmp_path: Path) -> None:
    venv.create(tmp_path / "bare", with_pip=False, symlinks=True)
    bare = check(Candidate(venv_python(tmp_path / "bare"), "bare"))
    assert not bare.ok and "unveil_core is not there (ModuleNotFoundError" in bare.problem
    assert bare.lines()[-1].endswith("(press Create environment, or name another Python above)")
    broken = check(Candidate(fake(tmp_path / "broken"), "broken"))
    assert not broken.ok and broken.problem.startswith("this Python does not start: exit code 3")
    old = tmp_path / "old"
    old.write_text('#!/bin/sh\necho \'{"python": "3.9.2", "unveil": "0.1.0"}\'\n')
    old.chmod(0o755)
    assert check(Candidate(old, "old")).problem.startswith("this is Python 3.9.2, unveil needs 3.11")


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script")
def test_one_that_never_answers_is_given_up(tmp_path: Path) -> None:
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nexec sleep 30\n")
    slow.chmod(0o755)
    assert "no answer within 0.3 s" in check(Candidate(slow, "slow"), timeout_s=0.3).problem


def test_the_first_that_has_it_is_found(tmp_path: Path) -> None:
    broken, good = Candidate(fake(tmp_path / "broken"), "broken"), Candidate(unveil_python(tmp_path), "good")
    found = find([broken, good])
    assert found is not None and found.ok and found.python == good.python
    found = find([broken])
    assert found is not None and not found.ok
    assert find([]) is None
