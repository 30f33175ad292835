"""Help that fits the screen, examples that work, and errors that programs read."""

from __future__ import annotations

import json
import shlex
from argparse import _SubParsersAction
from typing import Any

import pytest

from unveil_core.app.cli import main
from unveil_core.app.grammar.examples import EXAMPLES
from unveil_core.app.parser import command_parser
from unveil_core.pipeline.options.table import GROUPS, TABLE

TWO_SCREENS = 60
"""Lines at 80 columns: terminals open with 24 to 30."""


def parsers() -> dict[str, Any]:
    """Every verb's parser by name; of a batch those of its parts."""
    found: dict[str, Any] = {}
    verbs = next(a for a in command_parser()._actions if isinstance(a, _SubParsersAction))
    for name, parser in verbs.choices.items():
        parts = next((a for a in parser._actions if isinstance(a, _SubParsersAction)), None)
        found |= {name: parser} if parts is None else {f"{name} {part}": p for part, p in parts.choices.items()}
    return found


def help_of(words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(words) == 0
    return capsys.readouterr().out


def test_the_help_of_a_run_fits_two_screens(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = help_of(["run", "--help"], capsys, monkeypatch)
    assert len(shown.splitlines()) <= TWO_SCREENS and max(map(len, shown.splitlines())) <= 80
    whole = help_of(["run", "--help-all"], capsys, monkeypatch)
    for setting in TABLE:
        assert (f"  {setting.option} " in shown or f"  {setting.option}," in shown) == (not setting.expert)
        assert setting.option in whole
    for title in (title for name, title in GROUPS.items() if name != "method"):
        assert f"\n{title}:\n" in shown
    assert f"\n{GROUPS['method']}:\n" in whole
    again = help_of(["run", "--help"], capsys, monkeypatch)
    assert again == shown


def test_each_verb_has_three_examples_that_can_be_typed(capsys: pytest.CaptureFixture[str]) -> None:
    found = parsers()
    assert set(EXAMPLES) == set(found)
    for verb, lines in EXAMPLES.items():
        assert len(lines) == 3, verb
        for line in lines:
            words = shlex.split(line.partition(" > ")[0].removeprefix('eval "$(').removesuffix(')"'))
            assert words[0] == "unveil" and line in found[verb].format_help()
            given = command_parser().parse_args(words[1:])
            assert f"{given.verb} {getattr(given, 'part', '')}".strip() == verb


def test_all_options_say_what_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    for verb, parser in parsers().items():
        hidden = {id(action) for action, text in parser.experts if text}
        silent = [a.option_strings for a in parser._actions if a.option_strings and not a.help and id(a) not in hidden]
        assert [names for names in silent if names != ["-o", "--output"]] == [], verb


def test_verbs_are_listed_by_what_they_are_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = help_of(["--help"], capsys, monkeypatch)
    verbs = next(a for a in command_parser()._actions if isinstance(a, _SubParsersAction))
    for verb in verbs.choices:
        assert shown.count(f"\n    {verb} ") == 1
    assert shown.index("start here:") < shown.index("\n    run ") < shown.index("results:") < shown.index("one stage")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--json", "run", "nowhere", "-o", "w"], "Not found"),
        (["run", "nowhere", "-o", "w", "--json"], "Not found"),
        (["run", "--json"], "required"),
        (["--json", "run", "d", "-o", "w", "--seed", "x"], "a whole number"),
        (["status", "nowhere", "--json"], "Not a workspace"),
        (["run", "d", "-o", "w", "--remve", "car", "--json"], "did you mean --remove?"),
    ],
)
def test_errors_are_events_where_json_is_asked(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    said = capsys.readouterr()
    event = json.loads(said.out.splitlines()[-1])
    assert event["level"] == "error" and event["exit_code"] == 2 and message in event["message"] and event["mend"]
    assert said.err.startswith("unveil: error: ") and said.err.count("\n") == 1
    assert main([w for w in words if w != "--json"]) == 2 and capsys.readouterr().out == ""


def test_completion_knows_verbs_and_options(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("shtab")
    for shell in ("bash", "zsh"):
        assert main(["completion", shell]) == 0
        said = capsys.readouterr().out
        assert "--work-side" in said and "--iterations" in said and "reconstruct" in said and "draft" in said


def test_without_shtab_completion_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "shtab", None)
    assert main(["completion", "bash"]) == 2
    assert capsys.readouterr().err == "unveil: error: Not installed: shtab (pip install shtab)\n"
