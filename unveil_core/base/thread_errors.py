"""Errors in threads of libraries, which end the thread and nothing else: what it was to compute is missing from a result.

scipy's search for neighbours is one: where a thread of it finds no memory, the arrays come back with whatever was in them.
"""

from __future__ import annotations

import threading
from types import TracebackType

__all__ = ["ThreadErrors"]


class ThreadErrors:
    """A context in which errors that end threads are kept rather than printed.

    Attributes:
        found: the errors, in their order.
    """

    def __init__(self) -> None:
        self.found: list[BaseException] = []

    def __enter__(self) -> ThreadErrors:
        self._before = threading.excepthook
        threading.excepthook = self._take
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        threading.excepthook = self._before

    def check(self) -> None:
        """Raise the first error, if there is one."""
        if self.found:
            raise self.found[0]

    def _take(self, arguments: threading.ExceptHookArgs) -> None:
        self.found.append(arguments.exc_value or arguments.exc_type())
