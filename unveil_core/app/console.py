"""How a run reports: a progress bar on a terminal, plain lines in a log, JSON lines for programs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING, TextIO

from unveil_core.base.wording import about_as_long, shown

if TYPE_CHECKING:  # the stages' module loads NumPy
    from unveil_core.pipeline.stage import Reporter

__all__ = ["reporting", "reporting_for", "say"]


def say(text: object, file: TextIO | None = None) -> None:
    """Print lines for people, whatever names of strangers are in them; on standard output by default."""
    lines = [shown(line, longest=None) if not line.isprintable() else line for line in str(text).split("\n")]
    print("\n".join(lines), file=file or sys.stdout, flush=True)


def reporting_for(arguments: argparse.Namespace) -> AbstractContextManager[Reporter]:
    """A reporter as a command asks for it: ``--json``, ``--quiet``, ``--verbose``, or none of them."""
    return reporting(
        arguments.json, quiet=getattr(arguments, "quiet", False), verbose=getattr(arguments, "verbose", False)
    )


@contextmanager
def reporting(as_json: bool, *, quiet: bool = False, verbose: bool = False) -> Iterator[Reporter]:
    """A reporter for the surroundings.

    Args:
        as_json: each event as a line of JSON, whatever else is asked.
        quiet: warnings alone.
        verbose: each event as a line.
    """
    if as_json:
        yield lambda event: print(json.dumps(event), flush=True)
    elif quiet:
        yield _warnings
    elif verbose:
        yield _each
    elif sys.stderr.isatty():
        with _bar() as reporter:
            yield reporter
    else:
        yield _plain


LONGEST_NOTICE = 2000
"""Characters of what a stage tells: a list of names, say."""
NO_METRIC = ("t", "done", "total", "left_s")
"""Numbers of an event that are said otherwise, or not at all."""


def _text(event: dict[str, object]) -> str:
    metrics = "  ".join(f"{k} {v:g}" for k, v in event.items() if isinstance(v, float | int) and k not in NO_METRIC)
    left = event.get("left_s")
    rest = f"{about_as_long(left)} left" if isinstance(left, int) and left > 0 else ""
    return "  ".join(p for p in (shown(event["message"], longest=LONGEST_NOTICE), metrics, rest) if p)


def _plain(event: dict[str, object]) -> None:
    # Of an error the command says itself how it ended, once.
    if event["message"] in ("started", "done", "up to date") or event["level"] in ("warning", "notice"):
        say(f"{event['stage']:<12} {_text(event)}", sys.stderr)


def _warnings(event: dict[str, object]) -> None:
    if event["level"] == "warning":
        say(f"{event['stage']:<12} {_text(event)}", sys.stderr)


def _each(event: dict[str, object]) -> None:
    if event["level"] != "error":
        place = f"{event['done']}/{event['total']}  " if event["total"] else ""
        say(f"{event['stage']:<12} {place}{_text(event)}", sys.stderr)


@contextmanager
def _bar() -> Iterator[Reporter]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    columns = (
        TextColumn("{task.description:<12}", style="bold", markup=False),
        BarColumn(32),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}", style="dim", markup=False),
    )
    with Progress(*columns, console=Console(stderr=True), refresh_per_second=8) as progress:
        tasks = {}

        def report(event: dict[str, object]) -> None:
            stage = str(event["stage"])
            if event["level"] in ("warning", "notice"):
                progress.console.print(Text(_text(event)), highlight=False, soft_wrap=True)
                return
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=None, note="")
            total, done = event["total"], event["done"]
            if event["message"] == "done" or event["message"] == "up to date":
                known = progress.tasks[tasks[stage]].total or 1
                progress.update(tasks[stage], total=known, completed=known, note=_text(event))
            elif total:
                progress.update(tasks[stage], total=total, completed=done, note=_text(event))  # type: ignore[arg-type]
            else:
                progress.update(tasks[stage], note=_text(event))

        yield report
