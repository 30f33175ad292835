# SPDX-License-Identifier: GPL-3.0-or-later
"""A job as one bar from 0 to 1, and what is said beside it, for the sidebar and the status bar."""

from __future__ import annotations

from weakref import ref

from ...worker.job_state import JobState, duration
from ...worker.session import session
from ...worker.workspace_state import SOLVING, STAGES

__all__ = ["job_said", "outcome", "stage_said", "time_left", "whole"]

ALMOST = 0.99
"""What has not ended is not full."""
_job: ref[JobState] | None = None
_furthest = 0.0
"""How far the job that was last asked for was: no bar goes back."""


def whole(state: JobState, age_s: float) -> float:
    """How much of a job is done, 0 to 1: by the time that is left of the run, else by its stages.

    Args:
        age_s: how long it has run.
    """
    global _job, _furthest
    left = state.seconds_left() if state.run_left is not None else None
    if left is not None and age_s > 0:
        part = age_s / (age_s + left)
    elif state.place is not None:
        number, count = state.place
        part = (number - 1 + state.fraction) / count
    else:
        part = state.fraction
    same = _job is not None and _job() is state
    _job, _furthest = ref(state), min(max(part, _furthest if same else 0.0), ALMOST)
    return _furthest


def stage_said(state: JobState) -> str:
    """What it is at, for people."""
    name = STAGES.get(state.stage) or SOLVING.get(state.stage) or state.stage.title() or "Starting"
    return f"{name} ({state.place[0]} of {state.place[1]})" if state.place else name


def job_said(state: JobState) -> str:
    """The job and what it is at; once where both are the same."""
    stage = stage_said(state)
    return stage if session.title == stage else f"{session.title}: {stage}"


def time_left(state: JobState) -> str:
    """``2 min 05 s left``; empty where nobody knows."""
    left = state.seconds_left()
    return "" if left is None else f"{duration(left)} left"


def outcome(state: JobState) -> tuple[str, str]:
    """How a job has ended, and an icon; two empty texts as long as it runs."""
    if state.running:
        return "", ""
    if state.error:
        return state.error, "ERROR"
    if state.status == "cancelled":
        return "Cancelled; start again to go on", "INFO"
    return f"{session.title}: done in {duration(session.took_s)}", "CHECKMARK"
