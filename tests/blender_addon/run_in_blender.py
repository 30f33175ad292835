"""Run the files of ``in_blender/`` under a Python that has bpy, each in a process of its own.

bpy is not built to share a process: it can crash at exit, and keeps what one file did for the next. Any Python with bpy
and pytest will do; unveil_core is not needed there, for the add-on works with a Python of its own, as with a user.

    python tests/blender_addon/run_in_blender.py PYTHON ... [FILE ...]
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

__all__ = ["BLENDER", "WITH_OTHERS", "checks", "run_check", "unveil_python"]

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
BLENDER = ROOT / ".venv-bpy-5.0" / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
"""The Python that `make test` gives bpy 5.0, in an environment of its own."""
WITH_OTHERS = f"import sys; sys.path.append({sysconfig.get_path('purelib')!r}); "
"""Python text by which that one finds this environment's packages behind its own, NumPy 1 among them: for scripts that render."""


def checks() -> list[Path]:
    """The files to run."""
    return sorted((HERE / "in_blender").glob("check_*.py"))


def unveil_python(folder: Path, python: str = sys.executable) -> Path:
    """A Python that has this checkout's unveil_core, wherever it is started and whatever is in the environment."""
    script = folder / "unveil_python"
    if not script.exists():
        script.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{python}" "$@"\n')
        script.chmod(0o755)
    return script


def run_check(python: str, check: Path, *, shared: Path, timeout_s: float = 300) -> subprocess.CompletedProcess[str]:
    """Run one file; its user folders are new and go afterwards.

    Args:
        python: has bpy and pytest.
        check: the file.
        shared: a folder in which the files keep what is costly to make: a workspace that a run has finished.
    """
    with tempfile.TemporaryDirectory(prefix="unveil-bpy-") as name:
        folder = Path(name)
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("BLENDER_", "PYTHON"))}
        return subprocess.run(
            [
                python,
                "-m",
                "pytest",
                "-c",
                str(HERE / "in_blender/pytest.ini"),
                "--rootdir",
                str(HERE / "in_blender"),
                "--confcutdir",
                str(HERE / "in_blender"),
                str(check),
            ],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            env={
                **kept,
                "BLENDER_USER_RESOURCES": str(folder / "user"),
                "UNVEIL_PYTHON": str(unveil_python(folder)),
                "UNVEIL_ROOT": str(ROOT),
                "UNVEIL_SHARED": str(shared),
                "PYTHONDONTWRITEBYTECODE": "1",
            },
        )


def main(arguments: list[str]) -> int:
    """Run all files, or those named, under each Python; 1 if one fails. Ends with a line for each Python."""
    named = [Path(a).resolve() for a in arguments if a.endswith(".py")]
    outcomes = []
    for python in (a for a in arguments if not a.endswith(".py")):
        failed = []
        with tempfile.TemporaryDirectory(prefix="unveil-shared-") as shared:
            for check in named or checks():
                done = run_check(python, check, shared=Path(shared))
                said = done.stdout + (done.stderr if done.returncode else "")
                print(f"--- {check.name}: exit {done.returncode}\n{said}", flush=True)
                failed += [check.stem] if done.returncode else []
        outcomes.append((python, len(named or checks()), failed))
    for python, count, failed in outcomes:
        print(f"{python}: {count - len(failed)} of {count} files passed", *failed, flush=True)
    return int(any(failed for _, _, failed in outcomes))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
