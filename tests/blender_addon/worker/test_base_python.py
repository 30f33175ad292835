"""The Python that an environment is made with: which one is taken, a copy of it, and what is said when it is gone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from blender_addon.worker import environment
from blender_addon.worker.base_python import LEFT_OUT, base_python, lies_in, lost_base
from blender_addon.worker.interpreter import Candidate, candidates, check, find, venv_python
from blender_addon.worker.jobs import Job
from tests.blender_addon.tiny_wheel import tiny_wheel

needs_own_folder = pytest.mark.skipif(
    sys.platform == "win32" or str(Path(sys.base_prefix).resolve()) in ("/usr", "/usr/local"),
    reason="this Python does not lie in a folder of its own",
)


def says(path: Path, version: str) -> str:
    path.write_text(f"#!/bin/sh\necho {version}\n")
    path.chmod(0o755)
    return str(path)


def test_a_systems_python_goes_before_blenders_own(tmp_path: Path) -> None:
    own = says(tmp_path / "own", "3 11")
    environ = {"PATH": str(tmp_path)}
    assert base_python(own, environ) == own
    says(tmp_path / "python3", "3 9")
    assert base_python(own, environ) == own
    newer = says(tmp_path / "python3.13", "3 13")
    assert base_python(own, environ) == newer
    older = says(tmp_path / "python3.12", "3 12")
    assert base_python(own, environ) == older
    assert base_python(own, environ, minors=(13,)) == newer
    assert base_python(own, {"PATH": ""}, minors=(12,)) is None


@pytest.fixture
def blenders(tmp_path: Path) -> Path:
    """The Python of a Blender: this one's, in another place."""
    prefix = tmp_path / "blender/python"
    shutil.copytree(sys.base_prefix, prefix, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_OUT))
    return prefix / os.path.relpath(Path(sys.executable).resolve(), Path(sys.base_prefix).resolve())


def make(python: Path, folder: Path, wheel: Path, *options: str) -> None:
    job = Job([str(python), "-I", "-u", environment.__file__, str(folder), str(wheel), *options])
    state = job.wait(120)
    assert state.status == "done", list(state.log)


def starts(folder: Path) -> bool:
    program = "import encodings, ssl, unveil_core; print(unveil_core.__version__)"
    try:
        done = subprocess.run([venv_python(folder), "-I", "-c", program], capture_output=True, text=True)
    except OSError:
        return False
    return done.stdout == "0.1.0\n"


@needs_own_folder
def test_an_environment_with_a_copied_base_outlives_blender(
    blenders: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    assert lies_in(str(blenders), str(tmp_path / "blender")) and not lies_in(sys.executable, str(tmp_path))
    wheel = tiny_wheel(tmp_path / "wheels")
    kept, broken = tmp_path / "user/environment", tmp_path / "broken/environment"
    make(blenders, kept, wheel, "--copy-base")
    make(blenders, broken, wheel)
    assert starts(kept) and starts(broken) and not lost_base(kept) and not lost_base(broken)
    assert check(Candidate(venv_python(broken), "made by the add-on"), full=False).ok

    (tmp_path / "blender").rename(tmp_path / "blender moved")  # to where a newer one is unpacked, say
    assert starts(kept) and not lost_base(kept)
    assert not starts(broken) and lost_base(broken) == str(blenders.parent)
    # Its interpreter is a link to nowhere now; the user hears of it all the same, and of no other Python's lack instead.
    found = find(candidates(own=venv_python(broken), environ={"PATH": str(Path(sys.executable).parent)}))
    if found is not None and found.ok:  # this Python has unveil
        found = find(candidates(own=venv_python(broken), environ={}))
    assert found is not None and not found.ok and found.source == "made by the add-on"
    assert "made with is gone" in found.problem and "press Install" in found.problem

    shutil.rmtree(kept / "base")
    assert lost_base(kept) and not starts(kept)


def test_what_is_no_environment_has_lost_nothing(tmp_path: Path) -> None:
    assert lost_base(tmp_path) == ""
    (tmp_path / "pyvenv.cfg").write_text("version = 3.11\n")
    assert lost_base(tmp_path) == ""
