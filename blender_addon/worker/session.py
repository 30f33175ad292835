# SPDX-License-Identifier: GPL-3.0-or-later
"""The one job that runs for this Blender, and how the last one ended. No bpy here."""

from __future__ import annotations

import atexit
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from . import jobs
from .awaited_job import AwaitedJob
from .job_state import JobState, duration

__all__ = ["Session", "interrupts", "session"]


@dataclass
class Ticks:
    """Times that the interface's timer callback took, seconds."""

    count: int = 0
    total: float = 0.0
    longest: float = 0.0

    def add(self, seconds: float) -> None:
        self.count, self.total, self.longest = self.count + 1, self.total + seconds, max(self.longest, seconds)

    def text(self) -> str:
        mean = 1000 * self.total / max(self.count, 1)
        return f"interface callback: {self.count} times, mean {mean:.2f} ms, longest {1000 * self.longest:.2f} ms"


@dataclass
class Session:
    """Attributes:
    job: that runs, or has ended and is not concluded; None when nothing runs.
    title: of the job, for people.
    last: state of the latest job, running or ended.
    ticks: of the latest job.
    took_s: seconds that the latest job took, once it has ended.
    waiting: what its results wait for before they can be loaded; empty for nothing.
    file: counts the files that were opened: a job belongs to the one that it was started in.
    """

    job: jobs.Job | AwaitedJob | None = None
    title: str = ""
    last: JobState | None = None
    ticks: Ticks = field(default_factory=Ticks)
    waiting: str = ""
    took_s: float = 0.0
    file: int = 0

    @property
    def busy(self) -> bool:
        """Whether a job runs."""
        return self.job is not None

    @property
    def age_s(self) -> float:
        """How long the job has run, seconds; 0 where none does."""
        return 0.0 if self.job is None else time.monotonic() - self.job.started

    def begin(self, title: str, start: Callable[[], jobs.Job | AwaitedJob]) -> JobState:
        """Start a job; only one runs at a time.

        Raises:
            OSError: it cannot be started.
        """
        if self.job is not None:
            raise RuntimeError(f"{self.title} is still running")
        self.job, self.title, self.ticks = start(), title, Ticks()
        self.last = self.job.state
        return self.last

    def tick(self) -> JobState:
        """What the interface's timer calls: take in what has come."""
        assert self.job is not None
        return self.job.drain()

    def cancel(self) -> None:
        """Ask the job to end; it has ended within two seconds of further ticks."""
        if self.job is not None:
            self.job.cancel()

    def wait(self, each: Callable[[JobState], None] = lambda _: None) -> JobState:
        """Block until the job has ended; Ctrl+C and SIGTERM cancel it.

        Args:
            each: called after each drain.
        """
        assert self.job is not None
        with interrupts(self.job.cancel):
            while self.job.drain(0.1).running:
                each(self.job.state)
                time.sleep(0.02)
        each(self.job.state)
        return self.job.state

    def conclude(self) -> JobState:
        """The job has ended: nothing runs any more. Its log gets its last lines."""
        assert self.job is not None and self.last is not None
        self.took_s = time.monotonic() - self.job.started
        self.last.note(f"{self.title}: {self.last.status} after {duration(self.took_s)}")
        if self.ticks.count:
            self.last.note(self.ticks.text())
        self.job, self.waiting = None, ""
        return self.last

    def end(self) -> None:
        """End whatever runs, and wait for it: two seconds at most."""
        jobs.end_all()
        if self.job is not None:
            self.job.end()  # it may be looking for its program still
            self.conclude()


session = Session()
"""Blender's."""


@contextmanager
def interrupts(cancel: Callable[[], None]) -> Iterator[None]:
    """Ctrl+C and SIGTERM call ``cancel`` instead of ending this process."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {s: signal.signal(s, lambda *_: cancel()) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for s, handler in previous.items():
            # None: set by the program around this Python, which cannot be asked for it
            signal.signal(s, signal.SIG_DFL if handler is None else handler)


def register() -> None:
    atexit.register(session.end)


def unregister() -> None:
    atexit.unregister(session.end)
    session.end()
