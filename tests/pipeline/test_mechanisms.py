"""What a run can do without: each name is asked where it is listed, stages depend on their own only, and it works."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from docs.generate import PACKAGE, ROOT
from tests.remove.test_regions import scene, surfels_at
from unveil_core.app.parser import command_parser
from unveil_core.base.errors import SettingsError
from unveil_core.base.mechanisms import on, without
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.mechanisms import MECHANISMS, of_stage
from unveil_core.pipeline.run import stage_named
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.source_digest import modules_behind
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.remove.selection import select_removed
from unveil_core.workspace.workspace import Workspace

ASKED = re.compile(r"\bon\(\"(\w+)\"\)")


def asking_modules() -> dict[str, set[str]]:
    """The modules that ask for a mechanism, by its name."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        for name in ASKED.findall(path.read_text(encoding="utf-8")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found.setdefault(name, set()).add(module)
    return found


def test_nothing_else_is_called_as_the_question_is() -> None:
    """A variable of that name would hide it in its function, which no checker tells."""
    for modules in asking_modules().values():
        for module in modules:
            tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
            bound = [n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
            assert "on" not in [*bound, *(n.arg for n in ast.walk(tree) if isinstance(n, ast.arg))], module


def test_what_is_listed_is_asked_for_in_its_stage_and_nothing_else_is() -> None:
    asking = asking_modules()
    assert set(asking) == set(MECHANISMS)
    for name, modules in asking.items():
        behind = modules_behind(stage_named(MECHANISMS[name].stage).run.__module__)
        assert modules & set(behind), name


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_code_that_goes_with_a_mechanism_is_there(name: str) -> None:
    for part in MECHANISMS[name].apply:
        module, _, inside = part.partition(":")
        found = import_module(f"{PACKAGE}.{module}")
        for piece in inside.split(".") if inside else ():
            found = getattr(found, piece)


def test_a_stage_depends_on_its_own_mechanisms_only() -> None:
    assert {s.name for s in STAGES if "without" in s.settings} == {m.stage for m in MECHANISMS.values()}
    settings = RunSettings(without=("quilting", "remains"))
    told = {s.name: s.chosen(settings)["without"] for s in STAGES if "without" in s.settings}
    assert {name: names for name, names in told.items() if names} == {"inpaint": ["quilting"], "remove": ["remains"]}
    assert of_stage("inpaint", ("facades", "layered_fill")) == of_stage(
        "inpaint", ("layered_fill", "facades", "remains")
    )


def test_switching_off_ends_with_its_block_also_after_an_error() -> None:
    assert on("facades") and MECHANISMS["facades"].enabled
    with pytest.raises(ValueError), without(["facades"]), without(["layered_fill"]):
        assert not on("facades") and not on("layered_fill") and not MECHANISMS["facades"].enabled
        raise ValueError
    assert on("facades") and on("layered_fill")


def test_an_unknown_name_is_one_line_with_the_nearest() -> None:
    with pytest.raises(SettingsError, match="Not a mechanism: quiltin .*did you mean quilting"):
        RunSettings(without=("quiltin",))


def test_the_command_takes_it_more_than_once() -> None:
    words = ["run", "drive", "-o", "ws", "--without", "sun", "--without", "quilting,remains"]
    assert command_parser().parse_args(words).without == ("sun", "quilting", "remains")


def test_a_stage_runs_without_what_is_its_own(tmp_path: Path) -> None:
    seen: list[tuple[bool, bool]] = []

    def look(context: StageContext) -> None:
        seen.append((on("quilting"), on("remains")))
        context.output("seen.txt").write_text("seen")

    workspace = Workspace.create(tmp_path / "ws")
    stage = Stage("inpaint", look, (), ("seen.txt",), ("without",))
    settings = RunSettings()
    assert run_stages(workspace, [stage], settings, tmp_path) == ["inpaint"]
    assert run_stages(workspace, [stage], replace(settings, without=("remains",)), tmp_path) == []
    assert run_stages(workspace, [stage], replace(settings, without=("quilting", "remains")), tmp_path) == ["inpaint"]
    assert seen == [(True, True), (False, True)]
    recorded = workspace.state()["stages"]["inpaint"]["settings"]
    assert recorded == {"without": ["quilting"]}


def test_without_a_mechanism_the_result_is_another() -> None:
    """Of one: what touches a removed surfel goes with it, or stays."""
    surfels = surfels_at(np.array([[0.0, 0, 0], [0.05, 0, 0], [5.0, 0, 0]]), np.array([2, 0, 0]))
    gone = [select_removed(surfels, np.zeros(3, np.int64), scene(("car",)), too_close=0.08).removed.tolist()]
    with without(["border_surfels"]):
        gone.append(select_removed(surfels, np.zeros(3, np.int64), scene(("car",)), too_close=0.08).removed.tolist())
    assert gone == [[True, True, False], [True, False, False]]
