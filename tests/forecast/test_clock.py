"""The time left: what was expected, set right by what was measured."""

from __future__ import annotations

import pytest

from unveil_core.forecast.clock import RunClock


class Watch:
    """A clock that goes when it is told to."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_run_that_goes_as_expected_counts_down() -> None:
    watch = Watch()
    clock = RunClock({"a": 10.0, "b": 30.0}, watch)
    clock.begin("a")
    assert clock.left("a", 0, 0) == pytest.approx(40)
    watch.now += 4
    assert clock.left("a", 3, 100) == pytest.approx(36)
    watch.now += 6
    clock.end("a")
    assert clock.left("a", 1, 1) == pytest.approx(30)
    clock.begin("b")
    watch.now += 30
    clock.end("b")
    assert clock.left("b", 1, 1) == 0


def test_a_machine_that_takes_twice_the_time_is_believed_more_and_more() -> None:
    watch = Watch()
    clock = RunClock(dict.fromkeys("abcde", 20.0), watch)
    lefts = []
    for name in "abcd":
        clock.begin(name)
        watch.now += 40
        clock.end(name)
        lefts.append(clock.left(name, 1, 1))
    assert lefts[0] > 80 and lefts[-1] == pytest.approx(40, rel=0.1)
    assert all(before > after for before, after in zip(lefts[:-1], lefts[1:], strict=True))


def test_a_stage_that_takes_too_long_goes_by_its_own_pace() -> None:
    watch = Watch()
    clock = RunClock({"a": 10.0}, watch)
    clock.begin("a")
    watch.now += 60
    assert clock.left("a", 3, 4) == pytest.approx(20)
    assert clock.left("a", 0, 0) >= 0


def test_stages_that_were_up_to_date_are_not_waited_for() -> None:
    clock = RunClock({"a": 10.0, "b": 5.0}, Watch())
    clock.end("a")
    clock.begin("b")
    assert clock.left("b", 0, 1) == pytest.approx(5)
