"""What reaches a terminal is text: names of strangers give it no orders, and are no markup."""

from __future__ import annotations

import os
import select
import sys
from pathlib import Path

import pytest

from unveil_core.app.cli import main
from unveil_core.app.console import reporting, say
from unveil_core.base.wording import shown

ORDERS = "\x1b]52;c;cm0gLXJmIH4=\x07\x1b[2J\x9b2J\rx\n\u202ey\u2066\u200f\u2028z"
"""Sets the clipboard, clears the screen, begins new lines, turns the direction of writing."""


def event(message: str, **values: object) -> dict[str, object]:
    return {"t": 0.0, "stage": "import", "done": 1, "total": 2, "message": message, "level": "info", **values}


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("a  b\tc\nd", "a b c d"),
        ("straße ☂ 街", "straße ☂ 街"),
        ("\x1b[31m", "\\x1b[31m"),
        ("a\u202eb\u200fc\u2060", "a\\u202eb\\u200fc\\u2060"),
        ("\udcff", "\\udcff"),
        (Path("a\x07b"), "a\\x07b"),
    ],
)
def test_control_characters_are_written_out(text: object, seen: str) -> None:
    assert shown(text) == seen


def test_long_texts_are_cut_at_the_end_that_tells_less() -> None:
    assert shown("x" * 50, longest=10) == "x" * 10 + "…" and shown("ab" * 50, longest=3, tail=True) == "…bab"
    assert shown("x" * 5000, longest=None) == "x" * 5000


def test_lines_for_people_are_lines(capsys: pytest.CaptureFixture[str]) -> None:
    say("name      state\n  a\x1b[2J b")
    say("wrong", sys.stderr)
    said = capsys.readouterr()
    assert said.out == "name      state\na\\x1b[2J b\n" and said.err == "wrong\n"


@pytest.mark.parametrize("level", ["notice", "warning"])
def test_a_notice_gives_the_terminal_no_orders(level: str, capsys: pytest.CaptureFixture[str]) -> None:
    with reporting(False) as report:
        report(event(f"no depth for {ORDERS}", level=level))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("import") and line.isprintable() and "\\x1b]52" in line


@pytest.mark.skipif(os.name == "nt", reason="pseudo-terminals")
def test_a_terminal_shows_markup_and_orders_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    import pty

    leader, follower = pty.openpty()
    with os.fdopen(follower, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setenv("COLUMNS", "200")
        with reporting(False) as report:
            report(event(f"[/red] [link=http://x.org]{ORDERS}", level="notice"))
            report(event(f"[/dim] :smile: {ORDERS}"))
            report(event(f"[/dim]{ORDERS}"))
        said = ""
        while select.select([leader], [], [], 0.2)[0]:
            said += os.read(leader, 1 << 20).decode()
    os.close(leader)
    assert "[/red] [link=http://x.org]\\x1b]52" in said and "[/dim]" in said
    for order in ("\x1b]", "\x07", "\x1b[2J", "\x9b", "\u202e", "\u2028", "\u2066"):
        assert order not in said


def test_an_error_is_one_line_whatever_it_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(tmp_path / ORDERS), "-o", str(tmp_path / "w")]) == 2
    assert main(["batch", "status", str(tmp_path / ORDERS)]) == 2
    assert main(["fly" + ORDERS]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3 and all(line.isprintable() for line in lines)
