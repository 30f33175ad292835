"""What Unveil says when something is wrong: a catalogue of all its sentences, out of the source, and how they begin.

An error's line is the file, then the problem, then what to do: "clip.mp4: Not a drive (give a transforms.json or a folder)".
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from unveil_core.base import errors
from unveil_core.base.errors import UnveilError

ROOT = Path(__file__).parents[1]
BARRED = re.compile(
    r"^(is|was|are|were|there (is|are|was|were|is no such)|unknown)\b|^no \S+ is called|\b(is|are) no\b"
)
"""Beginnings that leave out who is meant, and a verb that says nothing."""
ERRORS = {name for name in errors.__all__ if issubclass(getattr(errors, name), UnveilError)}


def text_of(node: ast.expr) -> str | None:
    """A text or f-string, each value in it as "…"; None for anything else."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "…" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return f"{text_of(node.left) or '…'}{text_of(node.right) or '…'}"
    return None


def sentences(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """All texts of several words with their lines, but for docstrings."""
    left_out = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            left_out |= {id(part) for part in ast.walk(node) if part is not node}
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            left_out.add(id(node.value))
    for node in ast.walk(tree):
        text = text_of(node) if isinstance(node, ast.Constant | ast.JoinedStr) and id(node) not in left_out else None
        if text is not None and " " in text.strip():
            yield node.lineno, text


def problems(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """What errors for users say first, with their lines: texts, either text of a condition, and texts of a name set before."""
    named: dict[str, list[ast.expr]] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                if isinstance(target, ast.Name):
                    named.setdefault(target.id, []).append(node.value)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name not in ERRORS:
            continue
        waiting = [node.args[0]]
        while waiting:
            said = waiting.pop()
            if isinstance(said, ast.IfExp):
                waiting += [said.body, said.orelse]
            elif isinstance(said, ast.Name):
                waiting += [v for v in named.get(said.id, []) if not isinstance(v, ast.Name)]
            elif (text := text_of(said)) is not None:
                yield said.lineno, text


def catalogue() -> tuple[dict[str, str], dict[str, str]]:
    """All sentences of the program, and what its errors say first, by file and line."""
    said: dict[str, str] = {}
    wrong: dict[str, str] = {}
    for path in sorted((ROOT / "unveil_core").rglob("*.py")):
        tree, name = ast.parse(path.read_text(encoding="utf-8")), path.relative_to(ROOT).as_posix()
        said |= {f"{name}:{line} {text}": text for line, text in sentences(tree)}
        wrong |= {f"{name}:{line} {text}": text for line, text in problems(tree)}
    return said, wrong


SAID, WRONG = catalogue()


def test_the_catalogue_is_whole() -> None:
    assert len(SAID) > 1500 and len(WRONG) > 450
    assert {"Not a drive", "Cut short", "Not a workspace", "Given twice: the scale"} <= set(WRONG.values())
    assert any(text.startswith("Not the size of its camera") for text in WRONG.values())


def test_no_message_begins_without_saying_what_it_is_about() -> None:
    assert [where for where, text in {**SAID, **WRONG}.items() if BARRED.search(text)] == []


def test_a_problem_is_one_phrase_without_a_stop() -> None:
    assert [where for where, text in WRONG.items() if text.rstrip().endswith((".", "!")) or "\n" in text] == []


def test_what_is_barred_is_seen() -> None:
    tree = ast.parse(
        'what = "was made by others" if old else f"there is no {x}"\n'
        'raise DriveError(what, path=p)\nraise SettingsError(f"{x!r} is no number", mend="give one")\n'
    )
    found = [text for _, text in problems(tree)]
    assert sorted(found) == ["there is no …", "was made by others", "… is no number"]
    assert all(BARRED.search(text) for text in found)
