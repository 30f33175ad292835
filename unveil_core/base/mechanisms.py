"""What a run can do without: single mechanisms are switched off, to see what each is worth.

Where a mechanism is called, :func:`on` is asked; ``pipeline.mechanisms`` lists them all, each with the stage that it belongs to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

__all__ = ["on", "without"]

_off: frozenset[str] = frozenset()


def on(name: str) -> bool:
    """Whether a mechanism works in this process: all do, unless :func:`without` says otherwise."""
    return name not in _off


@contextmanager
def without(names: Iterable[str]) -> Iterator[None]:
    """A block in which some mechanisms do not work, in all threads of this process."""
    global _off
    before = _off
    _off = before | frozenset(names)
    try:
        yield
    finally:
        _off = before
