# SPDX-License-Identifier: GPL-3.0-or-later
"""What ``unveil check`` has told of a drive, as the import dialog shows it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ...formats.table.run_settings import SHOWN
from ...worker.job_state import JobState

__all__ = ["Checked", "checked_of", "in_words"]

OPTION, SENTENCE = re.compile(r"(?<![\w-])--[a-z][a-z-]*"), re.compile(r"[a-z]+[ ,]")
LABELS = {setting.option: setting.label for setting in SHOWN}
CALLED = {"way": "length"}
MOST = 6
"""Lines of each kind that are shown: the page has all."""


@dataclass(frozen=True)
class Checked:
    """Attributes:
    drive: that was looked at.
    error: why it cannot be read and what to do, in one line; empty where it can.
    facts: name and value each; assumed: a line each.
    findings: what looks wrong, with what to do, the worst first; asks: whether a run would not begin without being told to.
    page: that shows it all; empty where there is none.
    lacks_python: whether nothing was looked at, for there is no Python that could.
    """

    drive: str
    error: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    assumed: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    asks: bool = False
    page: str = ""
    lacks_python: bool = False


def checked_of(drive: Path, state: JobState) -> Checked:
    """What a check that has ended tells; its answer comes from this add-on's own process, but is taken as any other text."""
    told = state.answer.get("check")
    if not isinstance(told, dict):
        error = state.error or "The check ended without an answer (the log tells why)"
        return Checked(str(drive), error=in_words(error), lacks_python=state.exit_code is None)
    facts, assumed, findings = (told.get(name) or () for name in ("facts", "assumed", "findings"))
    return Checked(
        str(drive),
        facts=tuple((CALLED.get(key, str(key)), str(value)) for key, value in dict(facts).items())[:MOST],
        assumed=tuple(in_words(str(line)) for line in assumed)[:MOST],
        findings=tuple(_line(finding) for finding in findings)[:MOST],
        asks=any(bool(finding.get("asks")) for finding in findings),
        page=str(told.get("page") or ""),
    )


def _line(finding: dict[str, object]) -> str:
    return in_words(f"{finding.get('problem', '')} ({finding.get('mend', '')})")


def in_words(line: str) -> str:
    """A line of the command for a dialog: options are called as their fields are, and a sentence begins with a capital."""
    told = OPTION.sub(lambda found: LABELS.get(found.group(), found.group()), line)
    return told[:1].upper() + told[1:] if SENTENCE.match(told) else told
