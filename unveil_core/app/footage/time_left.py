"""The time left of a solve, in its events as a run has it in its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from unveil_core.forecast.clock import RunClock

__all__ = ["with_time_left"]

Reporter = Callable[[dict[str, object]], None]


def with_time_left(reporter: Reporter, steps: Mapping[str, float], clock: RunClock | None = None) -> Reporter:
    """A reporter that is told the same, and of each event that counts also ``left_s``, seconds until the solve ends.

    Args:
        steps: seconds that each step is expected to take, in order.
        clock: of these; other than of now for tests.
    """
    known = RunClock(steps) if clock is None else clock

    def told(event: dict[str, object]) -> None:
        stage, message, done, total = str(event["stage"]), event["message"], event["done"], event["total"]
        if stage not in steps:
            reporter(event)
            return
        if message == "started":
            known.begin(stage)
        elif message in ("done", "up to date"):
            known.end(stage)
        elif isinstance(done, int) and isinstance(total, int) and total > 0:
            event = {**event, "left_s": round(known.left(stage, done, total))}
        reporter(event)

    return told
