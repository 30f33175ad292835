"""The command does not obey the working folder: not numba in it, not Python, not the system's loader of libraries."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("yaml", reason="numba reads its settings from a file with PyYAML alone")

COMMAND = "import sys; sys.argv[1:] = ['--version']; from unveil_core.app.cli import main; main()"
"""What the script ``unveil`` does; what comes after it in a program is imported into the command's process."""
SETTINGS = "disable_jit: 1\nchrome_trace: ../written\n"


def python(folder: Path, *arguments: str, **environment: str) -> str:
    """What Python prints in a folder."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONSAFEPATH", "LD_LIBRARY_PATH")} | environment
    done = subprocess.run([sys.executable, *arguments], cwd=folder, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    "first",
    [
        f"{COMMAND}; import numba",
        f"import numba; {COMMAND}",
        f"import yaml; {COMMAND}; import unveil_core.base.kernels.compiled",
    ],
)
def test_numba_takes_no_settings_from_the_working_folder(tmp_path: Path, first: str) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here/.numba_config.yaml").write_text(SETTINGS)
    program = (
        f"{first}\nfrom unveil_core.base.kernels.compiled import njit\nfrom numba.core import config\nimport yaml\n"
        "f = njit(lambda x: x + 1)\nassert f(1) == 2 and f.signatures\n"
        "print(config.DISABLE_JIT, repr(config.CHROME_TRACE), int(config.OPT), yaml.safe_load('1'))"
    )
    assert python(tmp_path / "here", "-c", program, NUMBA_OPT="2") == "0 '' 2 1"
    # A script that imports numba itself before has had it read them; they end there.
    assert first.startswith("import numba") or not (tmp_path / "written").exists()


def test_settings_of_the_environment_are_the_users_own(tmp_path: Path) -> None:
    assert (
        python(tmp_path, "-c", f"{COMMAND}; import numba; print(numba.config.DISABLE_JIT)", NUMBA_DISABLE_JIT="1")
        == "1"
    )


@pytest.mark.parametrize("before", ["", "/opt/own"])
def test_programs_that_are_started_later_load_no_library_from_the_working_folder(tmp_path: Path, before: str) -> None:
    given = {"LD_LIBRARY_PATH": before} if before else {}
    program = f"{COMMAND}; import cv2, os; cv2.imread; print(os.environ.get('LD_LIBRARY_PATH'))"
    assert python(tmp_path, "-c", program, **given) == (before or "None")
    # Nor do those that the library starts for another program, whose own path of libraries is left as OpenCV makes it.
    library = "import cv2; from unveil_core.base.surroundings.programs import environment"
    program = f"{library}; print([f for f in environment().get('LD_LIBRARY_PATH', 'cv2').split(':') if 'cv2' not in f])"
    assert python(tmp_path, "-c", program, **given) == str([before] if before else [])


HERE = "raise SystemExit('imported from the working folder')"


def test_what_lies_in_the_working_folder_is_not_imported(tmp_path: Path) -> None:
    for name in ("typing", "signal", "argparse", "json", "numpy", "numba", "unveil"):
        (tmp_path / f"{name}.py").write_text(HERE)
    done = subprocess.run(
        [sys.executable, "-m", "unveil_core", "status", "."], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2 and "workspace" in done.stderr and "imported" not in done.stderr


def test_neither_is_it_by_what_the_command_starts(tmp_path: Path) -> None:
    (tmp_path / "multiprocessing.py").write_text(HERE)
    program = (
        "import sys; sys.path.remove('')\nfrom unveil_core.app.cli import main\nsys.argv[1:] = ['--version']; main()\n"
        "import subprocess; subprocess.run([sys.executable, '-c', 'import multiprocessing; print(multiprocessing)'], check=True)"
    )
    assert "<module 'multiprocessing' from" in python(tmp_path, "-c", program)
