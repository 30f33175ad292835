"""A job whose program is looked for first."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable

import pytest

from blender_addon.worker.awaited_job import AwaitedJob, Start
from blender_addon.worker.job_state import JobState
from blender_addon.worker.jobs import Job
from blender_addon.worker.session import Session


def started(program: str) -> Start:
    def start(state: JobState | None) -> Job:
        return Job([sys.executable, "-c", program], state=state)

    return start


def held(release: threading.Event, start: Start) -> Callable[[], Start]:
    def prepare() -> Start:
        assert release.wait(120)
        return start

    return prepare


def test_looking_does_not_hold_up_whoever_asks() -> None:
    release = threading.Event()  # for which the search waits: whoever waits for the search is never back
    job = AwaitedJob(held(release, started('print(\'{"stage": "mesh", "message": "fusing"}\')')), "Looking")
    state = job.drain()
    assert state.running and state.message == "Looking" and job.pid == 0
    release.set()
    assert job.wait(120) is state and state.status == "done"  # whoever holds the state sees all of it
    assert (state.stage, state.message) == ("mesh", "fusing") and job.pid > 0


def test_a_search_can_be_cancelled() -> None:
    release = threading.Event()
    job = AwaitedJob(held(release, started("raise SystemExit('it was started')")), "Looking")
    job.cancel()
    assert job.cancelling and job.drain().status == "cancelled"
    release.set()
    time.sleep(0.05)
    assert job.drain().status == "cancelled" and job.pid == 0


@pytest.mark.parametrize("error", [LookupError("No Python was found"), OSError("No Python was found")])
def test_what_is_not_found_is_one_line(error: Exception) -> None:
    def prepare() -> Start:
        raise error

    state = AwaitedJob(prepare, "Looking").wait(120)
    assert (state.status, state.error, state.exit_code) == ("failed", "No Python was found", None)


def test_a_program_that_cannot_be_started_is_one_line() -> None:
    state = AwaitedJob(lambda: lambda state: Job(["/nowhere/python"], state=state), "Looking").wait(20)
    assert state.status == "failed" and state.error.startswith("/nowhere/python: cannot be started: ")


def test_a_session_ends_it_at_any_time() -> None:
    release = threading.Event()
    session = Session()
    session.begin("a search", lambda: AwaitedJob(held(release, started("pass")), "Looking"))
    session.end()
    assert not session.busy and session.last is not None and session.last.status == "cancelled"
    session.begin("a sleep", lambda: AwaitedJob(lambda: started("import time; time.sleep(60)"), "Looking"))
    while session.job is not None and session.job.pid == 0:
        session.tick()
    session.end()
    assert session.last.status == "cancelled"
    release.set()
