"""What the project asks for fits its own licence, and what wheels bring besides is told."""

from __future__ import annotations

import ast
import re
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from requirements.licences import BROUGHT, KNOWN, brought_by, groups, plain, problem_with, reached

ROOT = Path(__file__).parents[2]
GROUPS = groups()


@pytest.mark.parametrize("extra", GROUPS, ids=lambda name: name or "core")
def test_what_is_asked_for_fits(extra: str) -> None:
    found = reached(GROUPS[extra])
    problems = []
    for name, package in found.items():
        data = package.metadata
        told = (data.get("License-Expression"), data.get("License"), data.get_all("Classifier") or [])
        problems += [p for p in (problem_with(name, *told),) if p is not None]
        if brought_by(package) and name not in BROUGHT:
            problems.append(f"{name} brings {', '.join(brought_by(package))}")
    assert problems == []


def test_the_core_is_installed_and_brings_nothing_under_the_gpl() -> None:
    found = reached(GROUPS[""])
    assert {plain(re.split(r"[^\w.-]", line)[0]) for line in GROUPS[""]} <= set(found)
    assert len(found) > 20 and not set(found) & (set(BROUGHT) | {"plyfile", "bpy", "usd-core"})
    assert [name for name, package in found.items() if brought_by(package)] == []


@pytest.mark.parametrize(
    ("expression", "words", "classifiers", "fits"),
    [
        ("MIT", None, [], True),
        ("Apache-2.0 AND (BSD-3-Clause OR GPL-2.0-only)", None, [], True),
        ("(MIT OR GPL-2.0-only) AND GPL-3.0-only", None, [], False),
        ("MIT OR GPL-2.0-only AND GPL-3.0-only", None, [], True),
        ("MIT AND", None, [], False),
        ("GPL-3.0-or-later OR MIT", None, [], True),
        ("Apache-2.0 WITH LLVM-exception AND Zlib", None, [], True),
        ("LGPL-2.1-or-later", None, [], False),
        (
            None,
            "GNU GENERAL PUBLIC LICENSE\nVersion 3",
            ["License :: OSI Approved :: GNU General Public License v3 (GPLv3)"],
            False,
        ),
        (None, None, ["License :: OSI Approved :: MIT License", "License :: Other/Proprietary License"], False),
        (None, None, ["License :: OSI Approved :: BSD License", "Programming Language :: Python"], True),
        (None, "Apache 2.0", [], True),
        (None, "Ask me", [], False),
        (None, None, [], False),
    ],
)
def test_licences_that_fit_and_that_do_not(
    expression: str | None, words: str | None, classifiers: list[str], fits: bool
) -> None:
    assert (problem_with("some-package", expression, words, classifiers) is None) == fits


def test_exceptions_have_a_reason_and_what_wheels_bring_is_in_the_docs() -> None:
    assert all(len(reason) > 20 for reason in (*KNOWN.values(), *BROUGHT.values()))
    told = " ".join((ROOT / name).read_text(encoding="utf-8") for name in ("LICENSE", "docs/development.md"))
    assert all(f"`{name}`" in told or f" {name} " in told for name in BROUGHT)
    asked = {name for lines in GROUPS.values() for name in reached(lines)}
    assert set(KNOWN) - {"bpy"} <= asked  # an exception that nothing needs goes


def imported() -> set[str]:
    """Modules from elsewhere that the core imports."""
    found = set()
    for path in (ROOT / "unveil_core").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {"unveil_core"}


def test_what_is_imported_is_asked_for_by_name() -> None:
    """Not only brought by chance, as a part of something else that may go."""
    asked = {plain(re.split(r"[^\w.-]", line)[0]) for name, lines in GROUPS.items() if name != "dev" for line in lines}
    owners = packages_distributions()
    parts = {"llvmlite": "numba", "markupsafe": "jinja2", "dask": "distributed"}
    missing = {}
    for module in imported():
        names = {plain(name) for name in owners.get(module, ())}
        if names and not names & asked and not {parts.get(name) for name in names} & asked:
            missing[module] = names
    assert missing == {}
