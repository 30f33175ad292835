"""Finding the Python that has unveil_core, and saying what is wrong with another."""

from __future__ import annotations

import os
import sys
import venv
from pathlib import Path

import pytest

from blender_addon.worker.interpreter import Candidate, Found, addon_version, candidates, check, find, venv_python
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
    for named in ("python", "./python", "//python", f"//{tmp_path}/python"):
        assert candidates(named, environ={}) == []
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
    assert "CPU cores" in lines[2] and "GB memory" in lines[2] and lines[3].startswith("GPU: ")
    assert lines[-1] == "Ready." and not any(line.startswith("Free disk") for line in lines)


def test_what_hinders_is_told_with_what_to_do() -> None:
    facts: dict[str, object] = {
        "addon": addon_version(),
        "unveil": addon_version(),
        "python": "3.11.7",
        "torch": "2.13.0",
        "numba": "0.66.0",
    }
    facts |= {"cpu": "A Processor", "cpus": 8, "memory_gb": 32.0, "gpu": "A Card", "gpu_memory_gb": 24.0, "cuda": True}
    facts["runs_use_gpu"] = True
    facts |= {"work_folder": "/streets", "work_free_gb": 120.5}
    assert Found(Path("/python"), "named", True, facts=facts).lines() == [
        "/python (named)",
        f"unveil {addon_version()}, Python 3.11.7, torch 2.13.0, numba 0.66.0",
        "A Processor, 8 CPU cores, 32 GB memory",
        "GPU: A Card, 24 GB",
        "Free disk: 120.5 GB in /streets",
        "Ready.",
    ]
    facts |= {"runs_use_gpu": False, "gpu_problem": "the package triton is missing (pip install triton)"}
    lines = Found(Path("/python"), "named", True, facts=facts).lines()
    missing = "the package triton is missing (pip install triton)"
    assert f"GPU: A Card, 24 GB; Unveil works on the processor: {missing}" in lines
    facts |= {"unveil": "0.0.1", "cuda": False, "gpu_unused": True, "memory_gb": 4.0, "work_free_gb": 1.0}
    lines = Found(Path("/python"), "named", True, facts=facts).lines()
    assert "GPU: none that torch can use; Unveil works on the processor" in lines
    older, gpu, memory, disk, ready = lines[-5:]
    assert older == f"unveil 0.0.1 is not of this add-on's version {addon_version()}: press Install"
    assert gpu == "This torch cannot use the NVIDIA GPU: empty Index for Torch and press Install"
    assert memory.startswith("Little memory: choose Draft") and disk.startswith("Little free disk: make room")
    assert ready == "Ready."
    newer = Found(Path("/python"), "named", True, facts={"addon": addon_version(), "unveil": "99.0.0"})
    assert newer.advice() == [f"unveil 99.0.0 is not of this add-on's version {addon_version()}: update the add-on"]


def test_the_free_disk_is_that_of_the_workspace_to_be(tmp_path: Path) -> None:
    script = tmp_path / "python"
    script.write_text('#!/bin/sh\necho \'{"python": "3.11.2", "unveil": "0.1.0"}\'\n')
    script.chmod(0o755)
    found = check(Candidate(script, "named"), work=tmp_path / "street/not yet")
    assert found.ok and found.facts["work_folder"] == str(tmp_path)
    assert isinstance(found.facts["work_free_gb"], float)


def test_what_is_wrong_is_one_line_with_its_mend(tmp_path: Path) -> None:
    venv.create(tmp_path / "bare", with_pip=False, symlinks=True)
    bare = check(Candidate(venv_python(tmp_path / "bare"), "bare"))
    assert not bare.ok and "Not found: unveil_core (ModuleNotFoundError" in bare.problem
    assert bare.lines()[-1].endswith("(press Install, or name another Python under Advanced)")
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
