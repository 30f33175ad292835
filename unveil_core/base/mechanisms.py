"""What a run can do without: single mechanisms are switched off, to see what each is worth.

Where a mechanism is called, :func:`on` is asked; ``pipeline.mechanisms`` lists them all, each with the stage that it belongs to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["on", "without"]

_off: ContextVar[frozenset[str]] = ContextVar("off", default=frozenset())


def on(name: str) -> bool:
    """Whether a mechanism works here: all do, unless :func:`without` says otherwise."""
    return name not in _off.get()


@contextmanager
def without(names: Iterable[str]) -> Iterator[None]:
    """A block in which some mechanisms do not work, in all threads that it starts (``parallel.in_context``), and in no others."""
    before = _off.set(_off.get() | frozenset(names))
    try:
        yield
    finally:
        _off.reset(before)
