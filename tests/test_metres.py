"""Lengths inside are metres: nothing is told how long a unit is."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
AT_THE_DOOR = ("drives/drive.py", "drives/importing/", "drives/scale_and_up.py", "drives/formats/", "solve/placing.py")
"""Where a drive's own unit is still known, as ``units_per_metre``."""


def names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Parameters, fields and keyword arguments with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            a = node.args
            for p in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg):
                if p is not None:
                    yield p.arg, p.lineno
        elif isinstance(node, ast.ClassDef):
            for field in node.body:
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    yield field.target.id, field.lineno
        elif isinstance(node, ast.Call):
            for k in node.keywords:
                if k.arg is not None:
                    yield k.arg, node.lineno


def test_unit_is_no_parameter_anywhere() -> None:
    found = []
    for path in sorted((ROOT / "unveil_core").rglob("*.py")):
        place = path.relative_to(ROOT / "unveil_core").as_posix()
        barred = {"unit"} if place.startswith(AT_THE_DOOR) else {"unit", "units", "units_per_metre", "metric"}
        found += [f"{place}:{line} {name}" for name, line in names(ast.parse(path.read_text())) if name in barred]
    assert not found
