"""The scripts in benchmarks/: they are run by hand and seldom, so what they import is checked here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
CODE = """
import importlib, sys
from pathlib import Path
folder = Path(sys.argv[1])
sys.path.insert(0, str(folder))  # where it is when one of them is run
failed = []
for path in sorted(folder.glob("*.py")):
    try:
        importlib.import_module(path.stem)
    except Exception as error:
        failed.append(f"{path.name}: {error!r}")
for path in sorted(folder.glob("quality/test_*.py")):
    try:
        importlib.import_module(f"quality.{path.stem}")
    except Exception as error:
        failed.append(f"{path.name}: {error!r}")
# What they start others with, as text.
for name in ("kills", "scale"):
    lines = importlib.import_module(name).CODE.splitlines()
    try:
        exec("\\n".join(line for line in lines if line.startswith(("import ", "from "))), {})
    except Exception as error:
        failed.append(f"{name}.py, CODE: {error!r}")
sys.exit("\\n".join(failed) or None)
"""


def test_every_script_finds_what_it_imports() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", CODE, str(ROOT / "benchmarks")]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
