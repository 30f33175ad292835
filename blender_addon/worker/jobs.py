# SPDX-License-Identifier: GPL-3.0-or-later
"""A job: a program that works in a process of its own and speaks JSON lines. No bpy here.

Its output is read by threads into a queue; :meth:`Job.drain` empties that for a bounded time, so a user interface that
calls it never waits. The process leads a group of its own, which :meth:`Job.cancel` ends as a whole.
"""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from .environment import system_program
from .job_state import JobState
from .workspace_state import stages_of

__all__ = ["Job", "end_all", "own_folder", "unveil_command", "unveil_job", "worker_environment"]

DRAIN_S = 0.002
"""Longest time that one drain takes: a tick of the interface has 0.02 s for all it does."""
GENTLE_S = 1.0
"""What a cancelled worker has to end by itself, before its whole group is killed: with that it is gone within two seconds."""
BEHIND_BLENDER = 5
"""Niceness of the work: it takes all processors, and an artist's hand goes first."""
LINGER_S = 0.5
"""What others of its group have to end after the worker has."""
WINDOWS = os.name == "nt"
BLENDERS_OWN = (
    "PYTHONHOME",
    "PYTHONPATH",
    "PYTHONSTARTUP",
    "PYTHONEXECUTABLE",
    "PYTHONUSERBASE",
    "PYTHONNOUSERSITE",
    "__PYVENV_LAUNCHER__",
)

_running: set[Job] = set()
_own_folder: tempfile.TemporaryDirectory[str] | None = None


def worker_environment(environ: Mapping[str, str] | None = None) -> dict[str, str]:
    """An environment without what would lead another Python into Blender's libraries."""
    found = {k: v for k, v in (os.environ if environ is None else environ).items() if k not in BLENDERS_OWN}
    return {**found, "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8", "PYTHONSAFEPATH": "1"}


def own_folder() -> str:
    """An empty folder of this process, in which its jobs work: Blender's own may be that of a stranger's .blend."""
    global _own_folder
    if _own_folder is None or not os.path.isdir(_own_folder.name):
        _own_folder = tempfile.TemporaryDirectory(prefix="unveil-jobs-", ignore_cleanup_errors=True)
    return _own_folder.name


class Job:
    """One process.

    Attributes:
        command: what is run.
        state: what it has reported; up to date after :meth:`drain`.
        started: clock of ``time.monotonic``.
    """

    def __init__(self, command: Sequence[str], *, cwd: str | Path | None = None, state: JobState | None = None) -> None:
        """Start it.

        Args:
            command: program and arguments.
            cwd: where; by default a folder of its own, so paths have to be absolute.
            state: to go on with, of what was looked for before; a new one by default.
        Raises:
            OSError: it cannot be started.
        """
        self.command = [str(part) for part in command]
        self.state = state or JobState()
        self.state.note("$ " + " ".join(self.command))
        self.started = time.monotonic()
        self._cancelled: float | None = None
        self._ended: float | None = None
        self._killed = False
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.BELOW_NORMAL_PRIORITY_CLASS if WINDOWS else 0  # type: ignore[attr-defined]
        group = {"creationflags": flags} if WINDOWS else {"start_new_session": True}
        self._process = subprocess.Popen(
            self.command,
            cwd=own_folder() if cwd is None else cwd,
            env=worker_environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            **group,
        )
        if not WINDOWS:  # before it has threads and children, which are as it is
            with suppress(OSError):
                behind = (
                    os.getpriority(os.PRIO_PROCESS, 0) + BEHIND_BLENDER
                )  # of Blender's own, which may be behind others
                os.setpriority(os.PRIO_PROCESS, self.pid, behind)
        self._readers = [
            threading.Thread(target=self._read, args=(stream,), name="unveil-job", daemon=True)
            for stream in (self._process.stdout, self._process.stderr)
        ]
        for reader in self._readers:
            reader.start()
        _running.add(self)

    @property
    def pid(self) -> int:
        """Of the process, which is its group's, too."""
        return self._process.pid

    @property
    def cancelling(self) -> bool:
        """Whether it was asked to end."""
        return self._cancelled is not None

    def _read(self, stream) -> None:  # type: ignore[no-untyped-def]
        with stream:
            for line in stream:
                self._lines.put(line)

    def drain(self, limit_s: float = DRAIN_S) -> JobState:
        """Take in what has come, for a bounded time, and see whether the process has ended. Never waits."""
        # In this order: whatever it wrote before it ended is in the queue by then.
        exit_code = self._process.poll()
        silent = not any(reader.is_alive() for reader in self._readers)
        stop = time.perf_counter() + limit_s
        while time.perf_counter() < stop:
            try:
                self.state.read(self._lines.get_nowait())
            except queue.Empty:
                self._look(exit_code, silent)
                break
        return self.state

    def _look(self, exit_code: int | None, silent: bool) -> None:
        """With all that it has reported taken in: whether it has ended, or has to be made to."""
        now = time.monotonic()
        if not self.state.running:
            return
        if exit_code is None:
            if self._cancelled is not None and not self._killed and now - self._cancelled > GENTLE_S:
                self._kill()
        elif silent or self._killed:
            self._finish(exit_code)
        else:
            # A grandchild that outlives the worker would hold the pipes open for ever.
            self._ended = self._ended or now
            if self._cancelled is not None or now - self._ended > LINGER_S:
                self._kill()

    def _finish(self, exit_code: int) -> None:
        self._kill()  # whatever is left of the group
        if self._process.stdin is not None:
            self._process.stdin.close()
        self.state.end(exit_code, cancelled=self._cancelled is not None and exit_code != 0)
        _running.discard(self)

    def cancel(self) -> None:
        """Ask it to end; :meth:`drain` sees to it that it has ended within two seconds, and then says so. Never waits."""
        if self._cancelled is not None or not self.state.running:
            return
        self._cancelled = time.monotonic()
        try:
            if WINDOWS:
                self._process.send_signal(signal.CTRL_BREAK_EVENT)  # type: ignore[attr-defined]
            else:
                os.killpg(self.pid, signal.SIGINT)
        except (OSError, ValueError):
            pass  # it has just ended

    def _kill(self) -> None:
        self._killed = True
        try:
            if WINDOWS:
                subprocess.run(
                    [system_program("taskkill.exe"), "/F", "/T", "/PID", str(self.pid)],
                    capture_output=True,
                    check=False,
                )
            else:
                os.killpg(self.pid, signal.SIGKILL)
        except OSError:
            pass  # nobody is left

    def wait(self, timeout_s: float | None = None) -> JobState:
        """Drain until it has ended; waits."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while self.drain(0.1).running and (deadline is None or time.monotonic() < deadline):
            time.sleep(0.01)
        return self.state

    def end(self) -> JobState:
        """Cancel and wait until everything has ended: two seconds at most."""
        self.cancel()
        return self.wait(2.5)


def end_all() -> None:
    """End what still runs: for quitting and for switching the add-on off."""
    for job in list(_running):
        job.cancel()
    for job in list(_running):
        job.end()


def unveil_command(python: str | Path, arguments: Sequence[str]) -> list[str]:
    """The ``unveil`` command; it ends when its standard input does."""
    # -P keeps the working folder off the module path: a torch.py beside a .blend must not be taken for torch.
    return [str(python), "-P", "-u", "-m", "unveil_core", *arguments, "--end-with-stdin"]


def unveil_job(python: str | Path, arguments: Sequence[str], state: JobState | None = None) -> Job:
    """A job of the ``unveil`` command, which ends with this process, however this ends.

    Args:
        python: an interpreter that has unveil_core.
        arguments: verb and options, with absolute paths.
        state: to go on with; a new one by default.
    Raises:
        OSError: the interpreter cannot be started.
    """
    job = Job(unveil_command(python, [*arguments, "--json"]), state=state)
    planned = stages_of(arguments[0])
    if "--until" in arguments:
        planned = planned[: planned.index(arguments[arguments.index("--until") + 1]) + 1]
    job.state.planned = planned
    return job
