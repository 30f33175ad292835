"""What a job's lines mean."""

from __future__ import annotations

import json
import os
import time

import pytest

from blender_addon.worker.job_state import JobState, duration
from blender_addon.worker.workspace_state import STAGES, stages_of


def event(**values: object) -> str:
    return json.dumps(
        {"t": 0.0, "stage": "reconstruct", "done": 0, "total": 0, "message": "", "level": "info", **values}
    )


def test_events_and_log_are_told_apart() -> None:
    state = JobState()
    state.read("some warning\n")
    state.read("{no json\n")
    state.read('{"t": 1}\n')
    state.read(event(done=20, total=80, message="step", loss=0.25) + "\n")
    assert (state.stage, state.done, state.total, state.fraction) == ("reconstruct", 20, 80, 0.25)
    assert state.metrics == {"loss": 0.25}
    assert list(state.log)[:3] == ["some warning", "{no json", '{"t": 1}']
    assert "20/80" in state.log[-1] and "loss 0.25" in state.log[-1]
    assert state.answer == {"t": 1}  # what a command was asked for


@pytest.mark.parametrize(
    ("line", "kept"),
    [
        ("$ pip --index-url https://user:pw@pip.x.org/whl/cpu", "$ pip --index-url https://pip.x.org/whl/cpu"),
        (
            "Looking in https://token@x.org:8080/simple, https://a:b@c@y.org/",
            "Looking in https://x.org:8080/simple, https://y.org/",
        ),
        ("https://user:p/w@x.org/simple", "https://x.org/simple"),
        ("git+https://x.org:8080/a/unveil.git@v1.2", "git+https://x.org:8080/a/unveil.git@v1.2"),
        ("https://x.org/simple unveil@v1", "https://x.org/simple unveil@v1"),
        (f"{os.path.expanduser('~')}/shots/a.blend", "~/shots/a.blend"),
        (os.path.expanduser("~") + "2/a", os.path.expanduser("~") + "2/a"),
    ],
)
def test_the_log_has_no_passwords_and_no_home_folder(line: str, kept: str) -> None:
    state = JobState()
    state.read(line + "\n")
    state.read(event(message=line, traceback=line))
    state.note(line)
    assert [text.removeprefix("reconstruct  ") for text in state.log] == [kept] * 4


def test_stages_end() -> None:
    state = JobState()
    state.read(event(stage="import", message="up to date", done=1, total=1))
    state.read(event(message="done", done=1, total=1, seconds=3.5))
    assert state.ended == {"import": "up to date", "reconstruct": "done"}
    state.read(event(stage="remove", message="no surfel carries this label", level="error", traceback="line 1\nline 2"))
    assert state.ended["remove"] == "failed" and state.error == "no surfel carries this label"
    assert "line 2" in state.log


def test_time_left_follows_the_pace_of_the_present_part() -> None:
    state = JobState()
    now = time.monotonic()
    state.read(event(done=10, total=100))
    assert state.seconds_left(now + 10) is None  # no pace yet: the first that it told was already 10
    state.read(event(done=30, total=100))
    state.stage_started = now
    assert state.seconds_left(now + 10) == pytest.approx(35)
    state.read(event(done=1, total=50))  # the next part
    assert state.seconds_left(time.monotonic() + 10) is None
    state.read(event(done=50, total=50))
    assert state.seconds_left(time.monotonic() + 10) is None


def test_time_left_is_of_the_run_where_it_says_so() -> None:
    state = JobState()
    state.read(event(done=10, total=100, left_s=300))
    assert state.run_left is not None and "left_s" not in state.metrics
    assert state.seconds_left(state.run_left[0] + 20) == pytest.approx(280)
    assert state.seconds_left(state.run_left[0] + 400) == 0


@pytest.mark.parametrize(
    ("exit_code", "line", "status", "error"),
    [
        (0, "unveil: error: of no consequence", "done", ""),
        (1, "unveil: failed: ws: the disk is full (…)", "failed", "ws: the disk is full (…)"),
        (2, "unveil: error: x: Not found", "bad input", "x: Not found"),
        (2, "", "bad input", "Bad input; the log tells which"),
        (1, "", "failed", "It failed; the log tells where"),
        (130, "unveil: cancelled", "cancelled", ""),
        (-9, "", "failed", "The worker was killed, perhaps because memory ran out; run it again to go on"),
        (-11, "", "failed", "The worker was ended by signal 11; run it again to go on"),
        (3221225477, "", "failed", "The worker ended with exit code 3221225477; the log tells more"),
    ],
)
def test_exit_codes(exit_code: int, line: str, status: str, error: str) -> None:
    state = JobState()
    state.read(line)
    assert state.running
    state.end(exit_code)
    assert (state.status, state.error, state.exit_code) == (status, error, exit_code)


def test_the_log_is_bounded() -> None:
    state = JobState()
    for i in range(20000):
        state.read(f"line {i}")
    assert len(state.log) == 5000 and state.log[-1] == "line 19999"


@pytest.mark.parametrize(("seconds", "text"), [(7.6, "8 s"), (125, "2 min 05 s"), (4200, "1 h 10 min")])
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_which_of_how_many_stages_runs() -> None:
    state = JobState(planned=stages_of("run"))
    assert state.place is None  # none has begun
    state.read(event(done=20, total=80))
    assert state.place == (5, len(STAGES))
    state.planned = stages_of("reconstruct")
    assert state.place is None  # there is but one
    assert stages_of("import") == ("import", "objects") and stages_of("status") == ()


def test_how_the_command_ended_is_no_stage() -> None:
    state = JobState()
    state.read(event(message="step"))
    state.read(event(stage="", level="error", message="no drive", exit_code=2))
    assert (state.stage, state.message, state.ended, state.error) == ("reconstruct", "step", {}, "")
    state.read("unveil: error: no drive")
    assert state.error == "no drive"
