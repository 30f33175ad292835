"""The core runs with NumPy of the series 1 as well, in an environment of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-numpy-1" / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
PARTS = (
    "tests/base/pictures",
    "tests/drives/formats/test_tables.py",
    "tests/drives/formats/test_safe_pickle.py",
    "tests/drives/formats/test_transforms_json.py",
    "tests/surfels/test_ply.py",
)
"""What touches files, types and OpenCV most."""


@pytest.mark.skipif(not PYTHON.is_file(), reason="there is no NumPy 1: make .venv-numpy-1/.installed")
def test_pictures_tables_and_files_with_numpy_1() -> None:
    told = subprocess.run([PYTHON, "-c", "import numpy; print(numpy.__version__)"], capture_output=True, text=True)
    assert told.stdout.startswith("1.26"), told.stderr
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    command = [PYTHON, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=0", *PARTS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment, timeout=300)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
