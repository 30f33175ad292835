"""A solve tells how long it still takes, from what was expected and from its pace."""

from __future__ import annotations

from unveil_core.app.footage.time_left import with_time_left
from unveil_core.forecast.clock import RunClock
from unveil_core.forecast.solving import about_seconds, seconds_by_step, seconds_of_frames


def _event(stage: str, message: str = "", done: int = 0, total: int = 0) -> dict[str, object]:
    return {"stage": stage, "message": message, "done": done, "total": total, "level": "info"}


def test_the_time_left_falls_and_covers_the_steps_to_come() -> None:
    steps, now, told = {"decode": 10.0, "map": 60.0, "points": 30.0}, [0.0], []
    report = with_time_left(told.append, steps, RunClock(steps, lambda: now[0]))
    for at, event in (
        (0, _event("decode", "started")),
        (5, _event("decode", "decoding", 1, 2)),
        (10, _event("decode", "done")),
        (10, _event("map", "started")),
        (40, _event("map", "placing", 2, 4)),
        (70, _event("map", "placing", 4, 4)),
        (70, _event("map", "done")),
        (70, _event("rest", "of another", 1, 2)),
        (71, _event("points", "pairs", 0, 9)),
    ):
        now[0] = at
        report(event)
    left = [e.get("left_s") for e in told]
    assert left == [None, 95, None, None, 60, 30, None, None, 30]
    assert [e["message"] for e in told][:2] == ["started", "decoding"]


def test_a_slow_machine_is_noticed() -> None:
    steps, now, told = {"decode": 10.0, "map": 60.0}, [0.0], []
    report = with_time_left(told.append, steps, RunClock(steps, lambda: now[0]))
    report(_event("decode", "started"))
    now[0] = 40.0
    report(_event("decode", "done"))
    report(_event("map", "started"))
    report(_event("map", "placing", 0, 9))
    assert told[-1]["left_s"] > 90  # type: ignore[operator]


def test_steps_are_the_whole() -> None:
    steps = seconds_by_step(96, 88, (960, 540), 440, False)
    whole = seconds_of_frames(96, (960, 540)) + about_seconds(88, (960, 540), 440, False)
    assert abs(sum(steps.values()) - whole) < 1e-9
    assert list(steps) == ["decode", "look", "features", "match", "map", "rest", "points"]
