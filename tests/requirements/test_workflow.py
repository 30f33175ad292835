"""The workflow for Linux, macOS and Windows: it names what there is, and leaves out no Python and no Blender that is promised."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from requirements.lock import PYTHONS
from requirements.torch_of_machine import command

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).parents[2]
JOBS: dict[str, Any] = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8"))["jobs"]
SYSTEMS = ["ubuntu-latest", "macos-latest", "windows-latest"]
BLENDERS = ["4.2", "4.5", "5.0", "5.1", "5.2", "5.3"]


def test_every_system_python_and_blender_has_its_row() -> None:
    for job in ("core", "wheel"):
        matrix = JOBS[job]["strategy"]["matrix"]
        assert matrix["system"] == SYSTEMS and matrix["python"] == list(PYTHONS)
    matrix = JOBS["blender"]["strategy"]["matrix"]
    assert matrix["system"] == SYSTEMS and matrix["blender"] == BLENDERS == [
        row["blender"] for row in matrix["include"]
    ]
    locked = {path.stem.removeprefix("bpy-") for path in (ROOT / "requirements").glob("bpy-*.txt")}
    assert {"4.2", "4.5", "5.0"} <= locked <= set(BLENDERS)


def test_what_the_steps_call_is_there() -> None:
    lines = [line for job in JOBS.values() for step in job["steps"] for line in step.get("run", "").splitlines()]
    named = {word for line in lines for word in re.findall(r"(?:requirements|lint|tests)/[\w./-]*\w", line)}
    assert {"requirements/core.txt", "lint/style.py", "tests/blender_addon/run_in_blender.py"} <= named
    assert [name for name in named if not (ROOT / name).is_file() and name != "requirements/bpy"] == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = {line.split()[1] for line in lines if line.startswith("make ")}
    assert targets == {"dist"} and all(f"\n{target}:" in makefile for target in targets)


def test_torch_comes_without_cuda_on_linux_and_by_its_hash_elsewhere() -> None:
    assert command("linux")[-1].startswith("torch==2.") and any("whl/cpu" in word for word in command("linux"))
    assert all("--require-hashes" in command(system) for system in ("darwin", "win32"))
