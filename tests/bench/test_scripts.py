"""The scripts in benchmarks/: run by hand and seldom, so their imports are checked here, and that their list is whole."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(p.relative_to(ROOT) for p in (ROOT / "benchmarks").rglob("*.py") if p.name != "__init__.py")
CODE = """
import importlib, sys
failed = []
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception as error:
        failed.append(f"{name}: {error!r}")
# What they start others with, as text.
for name in ("benchmarks.robustness.kills", "benchmarks.machine.scale"):
    lines = importlib.import_module(name).CODE.splitlines()
    try:
        exec("\\n".join(line for line in lines if line.startswith(("import ", "from "))), {})
    except Exception as error:
        failed.append(f"{name}, CODE: {error!r}")
sys.exit("\\n".join(failed) or None)
"""


def test_every_script_finds_what_it_imports() -> None:
    slow = [p.relative_to(ROOT) for p in (ROOT / "tests/slow").rglob("test_*.py")]
    names = [".".join(path.with_suffix("").parts) for path in (*SCRIPTS, *slow)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        [sys.executable, "-c", CODE, *names], env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr


def test_a_script_finds_the_others_from_any_folder(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    for script in ("benchmarks/reconstruction/ablations.py", "benchmarks/robustness/faults.py"):
        code = f"import runpy; runpy.run_path({str(ROOT / script)!r}, run_name='imported')"
        ended = subprocess.run(
            [sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True
        )
        assert ended.returncode == 0, ended.stderr


def test_each_script_has_its_line() -> None:
    listed = set(re.findall(r"^\| `([a-z_/]+\.py)", (ROOT / "benchmarks/README.md").read_text(), flags=re.MULTILINE))
    run_by_hand = {str(p.relative_to("benchmarks")) for p in SCRIPTS if "__main__" in (ROOT / p).read_text()}
    assert run_by_hand == listed
