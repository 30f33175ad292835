"""Who writes, and where: each room of the program writes by the common ways, and none by one of its own."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import unveil_core

ROOT = Path(unveil_core.__file__).parent
STAGE = "the folder in which a stage writes, which the journal puts in its place"
EXPORT = "the new folder of an export, or the file of one"
SOLVE = "new files of a drive, or what a solve keeps for itself"
FOLDERS = {
    "base": "the ways themselves",
    "delivery": STAGE,
    "drives/importing": STAGE,
    "exports": EXPORT,
    "ground": STAGE,
    "inpaint": STAGE,
    "mesh": STAGE,
    "pipeline/steps": STAGE,
    "report": STAGE,
    "solve": SOLVE,
    "surfels": STAGE,
    "workspace": "a workspace's own files",
}
MODULES = {
    "app/batch.py": "whole_file",
    "app/bench.py": "whole_file",
    "app/check.py": "whole_file",
    "app/holdout_check.py": "OwnFolder",
    "app/render_views.py": "OwnFolder",
    "bench/pipeline.py": "OwnFolder",
    "bench/plot.py": "a file that it is given",
    "bench/reconstruction.py": "a copy of a drive, for the time of a measurement",
    "bench/rows/runs.py": "a copy of a workspace, for the time of a measurement",
    "bench/timing.py": "the system's counter of memory",
    "drives/exposure.py": STAGE,
    "drives/photographs.py": STAGE,
    "evaluate/evaluation.py": STAGE,
    "evaluate/holdout/drive.py": "a folder that it is given",
    "evaluate/holdout/planting.py": "a folder that it is given",
    "evaluate/holdout/scores.py": "a folder that it is given",
    "farm/manifest.py": "a batch's own folder",
    "farm/state.py": "a batch's own folder",
    "forecast/machine.py": "the user's cache",
    "labelling/preview.py": "OwnFolder",
    "marking/asked/record.py": "a folder that it is given",
    "marking/mark.py": "OwnFolder",
    "marking/page.py": "OwnFolder",
    "pipeline/run.py": "a workspace's own files",
    "pipeline/runner.py": "a workspace's own files",
    "pipeline/stage.py": STAGE,
    "pipeline/up_to_date.py": "a workspace's own files, and the user's cache",
}
"""Other modules that write: what, or by which way, whose name then stands in the module."""
WRITES = {
    *(
        "write_text",
        "write_bytes",
        "mkdir",
        "makedirs",
        "touch",
        "unlink",
        "rmdir",
        "rmtree",
        "symlink_to",
        "hardlink_to",
    ),
    *("symlink", "link", "chmod", "rename", "copyfile", "copy2", "copytree", "mkdtemp", "tofile", "savefig", "imwrite"),
    *("write_atomic", "write_bytes_atomic", "write_json_atomic", "write_image_atomic", "copied", "linked", "move"),
}


def writing(path: Path) -> set[str]:
    """The calls in a module that write, by name."""
    calls = (n.func for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call))
    names = {f.attr if isinstance(f, ast.Attribute) else f.id if isinstance(f, ast.Name) else "" for f in calls}
    return names & WRITES


WRITERS = {p.relative_to(ROOT).as_posix() for p in ROOT.rglob("*.py") if writing(p)}


def test_no_room_writes_by_a_way_of_its_own() -> None:
    elsewhere = {name for name in WRITERS if not name.startswith(tuple(f"{f}/" for f in FOLDERS))}
    assert elsewhere - set(MODULES) == set()
    assert set(MODULES) - elsewhere == set(), "they write no more"


@pytest.mark.parametrize("name", [name for name, way in MODULES.items() if way in ("OwnFolder", "whole_file")])
def test_a_result_that_a_user_places_goes_one_of_the_ways(name: str) -> None:
    names = {n.id for n in ast.walk(ast.parse((ROOT / name).read_text(encoding="utf-8"))) if isinstance(n, ast.Name)}
    assert MODULES[name] in names


def test_a_solve_and_its_steps_write_into_the_drives_new_files() -> None:
    assert "OwnFolder" in (ROOT / "solve/solve.py").read_text(encoding="utf-8")
