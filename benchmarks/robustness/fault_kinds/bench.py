"""What all faults share: the drive, the undisturbed run that others are compared with, random moments, going on to the end."""

from __future__ import annotations

import itertools
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.robustness.fault_kinds.runs import Ended, Run, Tally, begun_stages, digests, done, stage_now, whole
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive

HERE = Path(__file__).resolve().parent
LONGEST_S = 900.0
"""After which a run that does not end is ended, and counts as killed without a line."""


@dataclass
class Bench:
    """Attributes:
    root: folder for all that is made; drive: folder of the drive; wanted: files of the undisturbed run; whole_s: what that took.
    """

    root: Path
    drive: Path
    generator: np.random.Generator
    wanted: dict[str, str] = field(default_factory=dict)
    whole_s: float = 0.0
    numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def begin(self) -> None:
        """Make the undisturbed run, its kernels being compiled before."""
        # What Python loads when it is first needed, another user cannot load from where root's lies.
        check_drive(open_drive(self.drive))
        for name in ("compiled", "whole"):
            begun = time.monotonic()
            ended = Run(whole(self.drive, self.root / name), self.root / "errors").wait()
            if ended is None or ended.code:
                raise SystemExit(f"the undisturbed run failed: {ended}")
            self.whole_s = time.monotonic() - begun
        self.wanted = digests(self.root / "whole")
        if self.wanted != digests(self.root / "compiled"):
            raise SystemExit("two undisturbed runs differ")

    def new(self, name: str = "ws") -> Path:
        """A path where nothing is yet."""
        return self.root / f"{name}{next(self.numbers)}"

    def start(self, workspace: Path, *more: str, prepare: Callable[[], object] | None = None, drive: Path | None = None) -> Run:
        """A whole run of the drive."""
        errors = self.root / f"errors{next(self.numbers)}"
        return Run(whole(drive or self.drive, workspace, *more), errors, prepare)

    def moment(self, least: float = 0.2, share: float = 0.3) -> float:
        """Seconds to a random moment."""
        return float(self.generator.uniform(least, max(least, share * self.whole_s) + 1.0))

    def go_on(
        self, tally: Tally, workspace: Path, finished: set[str], *, drive: Path | None = None, but: tuple[str, ...] = ()
    ) -> Ended:
        """Run a workspace to its end undisturbed, and compare what comes of it; ``finished``: stages that must not run again."""
        ended = self.start(workspace, drive=drive).wait()
        assert ended is not None
        self.count_lost(tally, ended, finished)
        if ended.code:
            tally.wrong += 1
            tally.trouble.append(f"cannot be finished: {ended.text[-1500:]}")
        else:
            found, wanted = ({n: d for n, d in all_.items() if n not in but} for all_ in (digests(workspace), self.wanted))
            tally.compare(found, wanted)
        return ended

    @staticmethod
    def count_lost(tally: Tally, ended: Ended, finished: set[str]) -> None:
        again = sorted(finished & begun_stages(ended.text))
        tally.lost += len(again)
        if again:
            tally.trouble.append(f"made again: {again}")

    def series(
        self,
        tally: Tally,
        times: int,
        disturb: Callable[[Path, Run], None] | None = None,
        *,
        prepare: Callable[[Path], Callable[[], object]] | None = None,
        between: Callable[[Path], None] = lambda workspace: None,
        new: Callable[[], Path] | None = None,
        remove: Callable[[Path], None] = lambda workspace: shutil.rmtree(workspace, ignore_errors=True),
        lines: int | None = 1,
    ) -> None:
        """Disturb runs, each going on from the last, until they end all the same; then a new workspace.

        Args:
            times: disturbances in all.
            disturb: gets workspace and run at its start, returns when it has done something, or the run ends by itself.
            prepare: from the workspace what is called in each new process.
            between: called after each run that was disturbed.
            new, remove: make and clear away a workspace.
            lines: that a disturbed run must say.
        """
        while tally.times < times:
            workspace, finished = (new or self.new)(), set[str]()
            while True:
                calm = tally.times >= times
                before = None if calm or prepare is None else prepare(workspace)
                run = self.start(workspace, prepare=before)
                if not calm and disturb is not None:
                    disturb(workspace, run)
                ended = run.wait(LONGEST_S)
                if ended is None:  # a library that waits for memory for ever
                    run.send(signal.SIGKILL)
                    ended = run.wait()
                assert ended is not None
                self.count_lost(tally, ended, finished)
                if not ended.code:
                    tally.compare(digests(workspace), self.wanted)
                    break
                if calm:
                    tally.wrong += 1
                    tally.trouble.append(f"cannot be finished: {ended.text[-1500:]}")
                    break
                tally.note(ended, stage=stage_now(workspace), lines=lines, hide=(workspace, self.root))
                finished = done(workspace)
                between(workspace)
            remove(workspace)
