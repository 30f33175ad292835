"""The progress callback, by which long work reports and is cancelled."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol

__all__ = ["Progress", "heeding", "no_notice", "no_progress", "part_of", "stop_asked"]

_stop: ContextVar[threading.Event | None] = ContextVar("stop", default=None)


@contextmanager
def heeding(stop: threading.Event) -> Iterator[None]:
    """A block whose work, in all threads that it starts (``parallel.in_context``), is to end once this is set."""
    before = _stop.set(stop)
    try:
        yield
    finally:
        _stop.reset(before)


def stop_asked() -> bool:
    """Whether a signal asked this run to end. What waits for another process, in any thread, looks at it: a signal reaches the main
    thread alone, and there may tell only the next progress call."""
    stop = _stop.get()
    return stop is not None and stop.is_set()


class Progress(Protocol):
    """Called by long work after each unit: ``progress(done, total, message, loss=0.12)``.

    The callee may raise :class:`unveil_core.base.errors.Cancelled`; the caller lets it pass and leaves nothing half-written.
    """

    def __call__(self, done: int, total: int, message: str = "", **metrics: float) -> None: ...


def part_of(progress: Progress, number: int, count: int) -> Progress:
    """The progress of one of ``count`` alike parts of a work, ``number`` from 0, as progress of the whole."""

    if count == 1:
        return progress

    def told(done: int, total: int, message: str = "", **metrics: float) -> None:
        progress(number * total + done, count * total, f"block {number + 1} of {count}, {message}", **metrics)

    return told


def no_progress(done: int, total: int, message: str = "", **metrics: float) -> None:
    """Say nothing."""


def no_notice(line: str) -> None:
    """A notice that nobody listens to."""
