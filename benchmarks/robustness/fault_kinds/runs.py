"""Runs as real processes, and what is left of them: exit code, lines said, finished stages, files.

A run is a fork of this process, which has loaded what `unveil` loads: it has its own number, memory limits and signals, and starts
in a moment. What must be loaded anew (`LD_PRELOAD`) is started as a command.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import unveil_core.pipeline.run
import unveil_core.report.summary  # noqa: F401
from unveil_core.app.cli import main

OWN = ("workspace.json", "events.jsonl", ".digests.json", ".lock", "report/index.html")
"""What tells times, and differs from run to run."""
OPTIONS = ("--quality", "draft", "--iterations", "20", "--splats", "500", "--remove", "vehicle")


@dataclass
class Ended:
    """How a run ended: exit code (negative: the signal that ended it), and all that it wrote to standard error."""

    code: int
    text: str

    @property
    def lines(self) -> list[str]:
        """Those by which the command says how it ended."""
        return [line for line in self.text.splitlines() if line.startswith("unveil: ")]

    @property
    def has_traceback(self) -> bool:
        return "Traceback (most recent" in self.text or "Fatal Python error" in self.text


class Run:
    """A run that goes on.

    Args:
        arguments: of the command.
        errors: file for what it writes.
        prepare: called in the new process before the run.
    """

    def __init__(self, arguments: Sequence[str | Path], errors: Path, prepare: Callable[[], object] | None = None) -> None:
        self.errors, self.begun = errors, time.monotonic()
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if not self.pid:
            _be(arguments, errors, prepare)

    def send(self, number: int) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def wait(self, seconds: float | None = None) -> Ended | None:
        """How it ended; None where it still goes on after so long."""
        deadline = None if seconds is None else time.monotonic() + seconds
        while True:
            pid, status = os.waitpid(self.pid, 0 if deadline is None else os.WNOHANG)
            if pid:
                text = self.errors.read_text("utf-8", errors="replace") if self.errors.is_file() else ""
                return Ended(os.waitstatus_to_exitcode(status), text)
            if deadline is not None and time.monotonic() >= deadline:
                return None
            time.sleep(0.005)


def _be(arguments: Sequence[str | Path], errors: Path, prepare: Callable[[], object] | None) -> None:
    code = 70
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        handle = os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        if prepare is not None:
            prepare()
        code = main([os.fspath(a) for a in arguments])
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def whole(drive: Path, workspace: Path, *more: str) -> list[str | Path]:
    """Arguments of a whole run."""
    return ["run", drive, "-o", workspace, *OPTIONS, *more]


def done(workspace: Path) -> set[str]:
    """The stages that are finished, as the workspace says."""
    try:
        stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    except (OSError, ValueError, KeyError):
        return set()
    # A record of a result stays while a later attempt goes on.
    return {name for name, entry in stages.items() if "input_hash" in entry}


def stage_now(workspace: Path) -> str:
    """The stage that runs."""
    try:
        stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    except (OSError, ValueError, KeyError):
        return "start"
    return next((name for name, entry in stages.items() if entry.get("status") == "running"), "between")


def begun_stages(text: str) -> set[str]:
    """The stages that a run really ran, from what it wrote."""
    words = [line.split() for line in text.splitlines()]
    return {w[0] for w in words if len(w) == 2 and w[1] == "started"}


def digests(workspace: Path) -> dict[str, str]:
    """Of all files that a run must reproduce, by name."""
    found = {}
    for path in sorted(workspace.rglob("*")):
        name = path.relative_to(workspace).as_posix()
        if path.is_file() and not name.startswith(OWN):
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def everything(folder: Path) -> dict[str, tuple[int, int, str]]:
    """Size, time of change and digest of all files, for faults that may change nothing; but not who holds the lock."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != ".lock":
            stat = path.stat()
            found[str(path)] = (stat.st_size, stat.st_mtime_ns, hashlib.sha256(path.read_bytes()).hexdigest())
    return found


@dataclass
class Tally:
    """What came of one fault, over all times.

    Attributes:
        fault, expected: what is done, and what is to come of it, in words.
        times: how often it was done; lost: finished stages that were made again; wrong: results that differ from the
            undisturbed run's, in files, or that never came; changed: files that were changed although nothing may be.
        unclear: runs that said not one line, or a traceback; codes, stages: how often each.
        slowest_end_s: from the signal to the end of the process.
    """

    fault: str
    expected: str
    times: int = 0
    lost: int = 0
    wrong: int = 0
    changed: int = 0
    unclear: int = 0
    codes: dict[str, int] = field(default_factory=dict)
    stages: dict[str, int] = field(default_factory=dict)
    said: dict[str, int] = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)
    slowest_end_s: float = 0.0
    skipped: str = ""

    def note(self, ended: Ended, *, stage: str = "", lines: int | None = 1, hide: Sequence[Path] = ()) -> None:
        """Count one run on which the fault was brought.

        Args:
            lines: that it must say; None where it cannot say anything, killed as it was.
            hide: folders that are left out of what is kept of the lines.
        """
        self.times += 1
        self.codes[str(ended.code)] = self.codes.get(str(ended.code), 0) + 1
        if stage:
            self.stages[stage] = self.stages.get(stage, 0) + 1
        if ended.has_traceback or (lines is not None and len(ended.lines) != lines):
            self.unclear += 1
            self.trouble.append(ended.text[-1500:])
        for line in ended.lines:
            for folder in hide:
                line = line.replace(os.fspath(folder), "…")
            self.said[line] = self.said.get(line, 0) + 1

    def compare(self, found: dict[str, str], wanted: dict[str, str]) -> None:
        """Count files that are not those of the undisturbed run."""
        different = sorted(n for n in found.keys() | wanted.keys() if found.get(n) != wanted.get(n))
        self.wrong += len(different)
        if different:
            self.trouble.append(f"different: {different[:8]}")

    def to_json(self) -> dict[str, Any]:
        values = {k: v for k, v in self.__dict__.items() if v not in ("", [], 0.0) or k in ("lost", "wrong", "unclear")}
        return {**values, "said": dict(sorted(self.said.items(), key=lambda kv: -kv[1])[:6]), "trouble": self.trouble[:5]}
