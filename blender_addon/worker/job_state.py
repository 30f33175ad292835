# SPDX-License-Identifier: GPL-3.0-or-later
"""What a job has reported so far: its JSON lines, read one by one. No bpy here."""

from __future__ import annotations

import json
import os
import re
import time
from collections import deque
from dataclasses import dataclass, field

__all__ = ["JobState", "discreet", "duration"]

LOG_LINES = 5000
"""Kept of the log; more would be of no use in a text block."""
PASSWORD = re.compile(r"//(?:[^/?#\s]*@|[^/?#\s:]*:(?!\d*(?:[/?#\s]|$))\S*@)")
"""What stands before the host of an address; also where the password has a slash in it."""
NOT_SHOWN = frozenset(("t", "stage", "done", "total", "message", "level", "traceback", "seconds", "left_s"))
HINTS = {
    0: "",
    1: "It failed; the log tells where",
    2: "Bad input; the log tells which",
    130: "Cancelled; run it again to go on",
}
"""What an exit code of ``unveil`` means, for jobs that said no more themselves."""


def duration(seconds: float) -> str:
    """For people: ``8 s``, ``2 min 05 s``, ``1 h 10 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def discreet(text: str) -> str:
    """A text without names and passwords in addresses, and without the user's folder."""
    text = PASSWORD.sub("//", text)
    home = os.path.expanduser("~")
    return re.sub(rf"{re.escape(home)}(?![\w.-])", "~", text) if len(home) > 1 else text


@dataclass
class JobState:
    """Attributes:
    planned: stages that it goes through, in order; empty where that is not known.
    status: "running", "done", "failed", "bad input" or "cancelled".
    stage, done, total, message: of the latest event.
    metrics: numbers of the latest event that had some, as loss.
    ended: by stage, "done" or "up to date", or "failed".
    error: one readable line, empty as long as nothing is wrong.
    exit_code: of the process; None while it runs.
    log: the latest lines, as they came.
    run_left: seconds that were left of the run when it last said so, after the time of that.
    answer: the latest JSON object that was no event: what a command was asked for.
    """

    status: str = "running"
    stage: str = ""
    done: int = 0
    total: int = 0
    message: str = ""
    metrics: dict[str, float] = field(default_factory=dict)
    ended: dict[str, str] = field(default_factory=dict)
    error: str = ""
    exit_code: int | None = None
    planned: tuple[str, ...] = ()
    log: deque[str] = field(default_factory=lambda: deque(maxlen=LOG_LINES))
    stage_started: float = field(default_factory=time.monotonic)
    first_done: int = 0
    run_left: tuple[float, float] | None = None
    answer: dict[str, object] = field(default_factory=dict)

    @property
    def running(self) -> bool:
        """Whether the job has not ended."""
        return self.status == "running"

    @property
    def fraction(self) -> float:
        """Of the stage, 0 to 1; 0 where it does not tell."""
        return min(max(self.done / self.total, 0.0), 1.0) if self.total > 0 else 0.0

    @property
    def place(self) -> tuple[int, int] | None:
        """Which of how many stages runs, from 1; None where there is but one, or none has begun."""
        if len(self.planned) < 2 or self.stage not in self.planned:
            return None
        return self.planned.index(self.stage) + 1, len(self.planned)

    def seconds_left(self, now: float | None = None) -> float | None:
        """Of the run, as it said itself; of an older ``unveil``, of the stage by its pace. None where neither says anything."""
        now = time.monotonic() if now is None else now
        if self.run_left is not None:
            at, left = self.run_left
            return max(left - (now - at), 0.0)
        elapsed = now - self.stage_started
        made = self.done - self.first_done
        if made <= 0 or self.total <= self.done or elapsed < 1.0:
            return None
        return elapsed / made * (self.total - self.done)

    def read(self, line: str) -> None:
        """Take in a line of the job's output; what is no event is kept as log."""
        line = line.rstrip("\r\n")
        if line.startswith("{"):
            try:
                event = json.loads(line)
            except (ValueError, RecursionError):
                event = None
            if isinstance(event, dict) and isinstance(event.get("stage"), str):
                if "exit_code" not in event:  # how the command ended: it says so on standard error, too
                    self._take(event)
                return
            if isinstance(event, dict):
                self.answer = event
        if line.strip():
            self.note(line)
        for mark in ("unveil: error: ", "unveil: failed: "):
            if line.startswith(mark):
                self.error = line.removeprefix(mark)

    def note(self, line: str) -> None:
        """Put a line into the log, which is saved with the .blend and given to others."""
        self.log.append(discreet(line))

    def _take(self, event: dict) -> None:  # type: ignore[type-arg]
        stage, message = event["stage"], str(event.get("message", ""))
        done, total = (_count(event.get(k)) for k in ("done", "total"))
        # A stage counts anew for each of its parts: the pace of one part says nothing of the next.
        if stage != self.stage or done < self.done or total != self.total:
            self.stage_started, self.first_done = time.monotonic(), done
        if stage != self.stage:
            self.metrics = {}
        self.stage, self.message, self.done, self.total = stage, message, done, total
        left = event.get("left_s")
        if _is_number(left) and left >= 0:
            self.run_left = time.monotonic(), float(left)
        numbers = {k: float(v) for k, v in event.items() if k not in NOT_SHOWN and _is_number(v)}
        self.metrics = numbers or self.metrics
        if message in ("done", "up to date"):
            self.ended[stage] = message
        if event.get("level") == "error":
            self.ended[stage] = "failed"
            self.error = message or self.error
        if message:
            shown = f"{done}/{total}" if total else ""
            parts = (f"{stage:<12}", shown, message, *(f"{k} {v:g}" for k, v in numbers.items()))
            self.note(" ".join(p for p in parts if p))
        if event.get("traceback"):
            for line in str(event["traceback"]).splitlines():
                self.note(line)

    def end(self, exit_code: int, *, cancelled: bool = False) -> None:
        """The process has ended."""
        self.exit_code = exit_code
        if cancelled or exit_code == 130:
            self.status, self.error = "cancelled", ""
        elif exit_code == 0:
            self.status, self.error = "done", ""
        else:
            self.status = "bad input" if exit_code == 2 else "failed"
            if not self.error:
                self.error = HINTS.get(exit_code) or _killed(exit_code)
        self.note(f"ended with exit code {exit_code}: {self.error or self.status}")


def _is_number(value: object) -> bool:
    """Whether a value of an event is a number that can be shown."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e300 < value < 1e300


def _count(value: object) -> int:
    return int(value) if _is_number(value) else 0  # type: ignore[call-overload]


def _killed(exit_code: int) -> str:
    if exit_code in (-9, 137):
        return "The worker was killed, perhaps because memory ran out; run it again to go on"
    if exit_code < 0:
        return f"The worker was ended by signal {-exit_code}; run it again to go on"
    return f"The worker ended with exit code {exit_code}; the log tells more"
