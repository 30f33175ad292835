"""Runs that are ended from outside, at random moments, in and between stages."""

from __future__ import annotations

import signal
import time
from pathlib import Path

from benchmarks.robustness.fault_kinds.bench import Bench
from benchmarks.robustness.fault_kinds.runs import Run, Tally


def ended_by(bench: Bench, number: int, times: int) -> Tally:
    """Runs that get a signal."""
    killed = number == signal.SIGKILL
    name = {signal.SIGKILL: "kill -9", signal.SIGTERM: "SIGTERM", signal.SIGINT: "Ctrl-C (SIGINT)"}[signal.Signals(number)]
    expected = "ends at once, goes on" if killed else "130, one line, goes on"
    tally = Tally(name, expected)

    def disturb(workspace: Path, run: Run) -> None:
        # Looks whether it is still there without taking its end away.
        time.sleep(bench.moment())
        begun = time.monotonic()
        run.send(number)
        deadline = begun + 120.0
        while _runs(run.pid) and time.monotonic() < deadline:
            time.sleep(0.01)
        tally.slowest_end_s = round(max(tally.slowest_end_s, time.monotonic() - begun), 2)

    bench.series(tally, times, disturb, lines=0 if killed else 1)
    return tally


def _runs(pid: int) -> bool:
    """Whether a process works; one that ended and is not waited for does not."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
