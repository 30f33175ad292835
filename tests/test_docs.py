"""The pages for people: what they link to is there, and what they promise to list is listed."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from docs.generate import ORDER, ROOT
from tests.drives.captures import write_picture
from unveil_core import open_drive
from unveil_core.app.cli import main
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points
from unveil_core.exports.registry import FORMATS
from unveil_core.pipeline.graph import STAGES

PAGES = sorted(
    [ROOT / name for name in ("README.md", "CHANGELOG.md", "blender_addon/README.md", "benchmarks/README.md")]
    + [*(ROOT / "docs").glob("*.md"), *(ROOT / "sample_scenes").rglob("README.md")]
)
FOLDERS = ("unveil_core", "blender_addon", "benchmarks", "tests", "docs", "sample_scenes", "LICENSES")


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def code_blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text_of(page), flags=re.MULTILINE | re.DOTALL)


def prose(page: Path) -> str:
    """The page without its code blocks."""
    return re.sub(r"^```.*?^```", "", text_of(page), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """What a link may name behind ``#``: the headings, as GitHub makes anchors of them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


def links(page: Path) -> Iterator[str]:
    yield from re.findall(r"\]\(([^)\s]+)\)", prose(page))


def named_paths(page: Path) -> Iterator[Path]:
    """Paths of the repository that a page names in backticks: from its root, or from unveil_core's packages."""
    for span in re.findall(r"`([^`\n]+)`", prose(page)):
        for word in span.split():
            first, *rest = word.rstrip("/").split("/")
            if not rest or re.search(r"[<>*{}…]|[A-Z]{4,}", word.removesuffix(".md")):
                continue
            if first in FOLDERS:
                yield ROOT / word
            elif first in ORDER and (word.endswith(".py") or (ROOT / "unveil_core" / first / rest[0]).is_dir()):
                yield ROOT / "unveil_core" / word


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page: Path) -> None:
    broken = []
    for link in links(page):
        if link.startswith(("http://", "https://")):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert broken == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_named_files_are_there(page: Path) -> None:
    assert [str(path.relative_to(ROOT)) for path in named_paths(page) if not path.exists()] == []


def test_the_guard_sees_paths() -> None:
    found = {str(path.relative_to(ROOT)) for path in named_paths(ROOT / "docs" / "development.md")}
    assert {"unveil_core/pipeline/graph.py", "blender_addon/choice/box_gizmos.py", "docs/generate.py"} <= found
    assert "unveil_core/inpaint/frames/compose.py" in {
        str(path.relative_to(ROOT)) for path in named_paths(ROOT / "docs" / "method.md")
    }


@pytest.mark.parametrize("page", [page for page in PAGES if code_blocks(page, "json")], ids=name)
def test_examples_are_json(page: Path) -> None:
    for block in code_blocks(page, "json"):
        json.loads(block)


def test_the_example_of_a_drive_opens(tmp_path: Path) -> None:
    """It looks along +y, 1.6 m above the ground, as the page says."""
    (tmp_path / "transforms.json").write_text(code_blocks(ROOT / "docs/input.md", "json")[0])
    write_points(PointCloud(np.zeros((3, 3)) + [[0.0], [1.0], [2.0]]), tmp_path / "points.ply")
    for frame in json.loads((tmp_path / "transforms.json").read_text())["frames"]:
        write_picture(tmp_path / frame["file_path"])
    drive = open_drive(tmp_path)
    cameras = [frame.camera for frame in drive.frames]
    assert drive.units_per_metre == 1 and drive.scale_source == "metric"
    assert np.allclose(cameras[0].forward, (0, 1, 0)) and np.allclose(cameras[0].centre, (0, 0, 1.6))
    assert np.allclose(cameras[-1].centre - cameras[0].centre, (0, 1.2 * (len(cameras) - 1), 0))


def keys_read() -> set[str]:
    """The keys that the reader of transforms.json asks for: strings that it looks up, whatever the way."""
    formats = ROOT / "unveil_core/drives/formats"
    files = [formats / "transforms_json.py", *(formats / "nerfstudio").glob("*.py")]
    found: set[str] = set()
    for node in (n for file in files for n in ast.walk(ast.parse(text_of(file)))):
        asked: list[ast.expr] = []
        if isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            asked = list(node.args) if called in ("get", "number", "file") else []
        elif isinstance(node, ast.Subscript):
            asked = [node.slice]
        elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            asked = [node.left]
        found |= {a.value for a in asked if isinstance(a, ast.Constant) and isinstance(a.value, str)}
    return {key for key in found if key.islower()}


def test_every_key_of_a_drive_is_described() -> None:
    asked = keys_read()
    assert {"fl_x", "metric", "ply_file_path", "semantic_path", "applied_scale"} <= asked
    assert asked - set(re.findall(r"`([a-z_0-9]+)`", text_of(ROOT / "docs/input.md"))) == set()


@cache
def help_of(*words: str) -> str:
    """What ``unveil WORDS --help`` shows, the options for experts too."""
    shown = StringIO()
    with redirect_stdout(shown):
        main([*words, "--help"])
        if "--help-all" in shown.getvalue():
            main([*words, "--help-all"])
    return shown.getvalue()


def options_of(*verb: str) -> set[str]:
    return set(re.findall(r"--[a-z][a-z-]+", help_of(*verb)))


def verbs() -> list[str]:
    return re.findall(r"^    ([a-z]+(?:-[a-z]+)*)(?: |$)", help_of(), flags=re.MULTILINE)


def test_every_command_and_option_is_described() -> None:
    page = text_of(ROOT / "docs/command.md")
    described = set(re.findall(r"--[a-z][a-z-]+", page))
    found = verbs()
    assert {"run", "render", "reoptimize", "doctor", "run-block"} <= set(found)
    missing = [verb for verb in found if not re.search(rf"`(unveil )?{verb}\b", page)]
    for verb in found:
        missing += [f"{verb} {o}" for o in sorted(options_of(verb) - {"--help"}) if o not in described]
    assert missing == []


def shown_commands(page: Path) -> Iterator[str]:
    """Calls of ``unveil`` that a page shows, in blocks and in lines, each as one line."""
    text = text_of(page)
    blocks = re.findall(r"^```(?:bash|sh|)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    blocks += re.findall(r"(?:^    .*\n?)+", text, flags=re.MULTILINE)
    lines = [line.strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    for line in (*lines, *(span.replace("\n", " ") for span in re.findall(r"`([^`]+)`", prose(page)))):
        if match := re.match(r"(?:\.venv/bin/)?unveil (.*)", line):
            yield match[1].partition(" #")[0]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_that_pages_show_can_be_given(page: Path) -> None:
    wrong = []
    for command in shown_commands(page):
        words = command.split()
        verb = words[:2] if words[0] in ("batch", "bench") else words[:1]
        if (
            words[0].startswith("-")
            or words[0] in ("…", "STAGE", "VERB", "COMMAND")
            or any("|" in word for word in verb)
        ):
            continue
        if words[0] not in verbs():
            wrong.append(command)
            continue
        asked = {word.partition("=")[0] for word in words if re.match(r"--[a-z]", word)}
        wrong += [f"{command}: {option}" for option in asked - options_of(*verb)]
        if verb == ["export"] and "--to" in words and (to := words[words.index("--to") + 1]).islower():
            wrong += [f"{command}: {kind}" for kind in re.split(r"[,|]", to) if kind not in FORMATS]
    assert wrong == []


def test_every_output_of_a_stage_is_described() -> None:
    files = text_of(ROOT / "docs/workspace.md").partition("## Files")[2]
    assert [o for stage in STAGES for o in stage.outputs if f"`{o}" not in files] == []
