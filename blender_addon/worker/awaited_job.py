# SPDX-License-Identifier: GPL-3.0-or-later
"""A job whose program is looked for first, in a thread: a Python that does not answer costs 20 seconds. No bpy here."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from .job_state import JobState
from .jobs import DRAIN_S, Job

__all__ = ["AwaitedJob", "Start"]

Start = Callable[[JobState | None], Job]
"""Starts a job, which goes on with the state that it is given. OSError: it cannot be started."""


class AwaitedJob:
    """To be used as a :class:`~.jobs.Job`.

    Attributes:
        state: what it has reported; up to date after :meth:`drain`.
        started: clock of ``time.monotonic``.
    """

    def __init__(self, prepare: Callable[[], Start], told: str) -> None:
        """Begin to look.

        Args:
            prepare: finds out how the job is started, in a thread. LookupError: it cannot be, in one line.
            told: what is looked for, for people.
        """
        self.state = JobState(message=told)
        self.started = time.monotonic()
        self._prepare = prepare
        self._start: Start | None = None
        self._problem = ""
        self._job: Job | None = None
        self._cancelled = False
        self._thread = threading.Thread(target=self._look, name="unveil-search", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Of the process; 0 as long as there is none."""
        return 0 if self._job is None else self._job.pid

    @property
    def cancelling(self) -> bool:
        """Whether it was asked to end."""
        return self._cancelled or (self._job is not None and self._job.cancelling)

    def _look(self) -> None:
        try:
            self._start = self._prepare()
        except (LookupError, OSError) as error:
            self._problem = str(error)

    def drain(self, limit_s: float = DRAIN_S) -> JobState:
        """As of a job. Never waits."""
        if self._job is not None:
            return self._job.drain(limit_s)
        if self._cancelled and self.state.running:
            self.state.end(130, cancelled=True)
        elif self.state.running and not self._thread.is_alive():
            self._begin()
        return self.state

    def _begin(self) -> None:
        if self._start is not None:
            try:
                self._job = self._start(self.state)
                return
            except OSError as error:
                self._problem = f"{error.filename or 'The program'}: cannot be started: {error.strerror}"
        self.state.status, self.state.error = "failed", self._problem or "The search for a Python failed"
        self.state.note(self.state.error)

    def cancel(self) -> None:
        """Ask it to end. Never waits."""
        if self._job is not None:
            self._job.cancel()
        else:
            self._cancelled = True

    def wait(self, timeout_s: float | None = None) -> JobState:
        """Drain until it has ended; waits."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while self.drain(0.1).running and (deadline is None or time.monotonic() < deadline):
            time.sleep(0.01)
        return self.state

    def end(self) -> JobState:
        """Cancel and wait until everything has ended: two seconds at most. A search is left to itself."""
        self.cancel()
        return self.wait(2.5)
