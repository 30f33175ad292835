"""Work on ranges, shared out between threads.

A compiled kernel takes ``(start, stop, *arguments)``, releases the interpreter's lock, and writes only what belongs to its
range. Ranges of whole chunks are handed out as threads become free, large ones first (Polychronopoulos and Kuck, *Guided
self-scheduling*, 1987): each call of a kernel takes tens of microseconds before it works. Since a chunk's result does not depend
on who computes it, results are the same for any number of threads.

Work on whole frames that releases the lock most of its time is shared out by :func:`each`, a frame a thread; kernels that such
work calls then stay in its thread.

What is true of the caller alone (a run's mechanisms, its device, its number of threads, whether it is to stop) lies in context
variables, and all these threads work in a copy of the caller's context: two runs of one process know nothing of each other.
Threads that are started otherwise get it by :func:`in_context`.

These are the only ways in which the package's own kernels use several threads. Threads of our own, not numba's parallel
loops: those compile a loop's body twice, and which of the two copies runs depends on whether the code was compiled in this
process or comes from the cache. With fast math the two round differently, and a drive unveiled twice would not give the
same files. They also keep a count of threads of their own, and where neither TBB nor OpenMP is found they end the process
when two threads enter them.
"""

from __future__ import annotations

import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from functools import lru_cache, partial
from queue import SimpleQueue
from typing import Any, ParamSpec, TypeVar

__all__ = ["EXACT", "FAST", "each", "in_context", "in_parallel", "thread_count", "threads", "works_alone"]

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")

FAST: dict[str, Any] = {"fastmath": True, "cache": True, "nogil": True, "boundscheck": False, "error_model": "numpy"}
"""How numba compiles a kernel for :func:`in_parallel` whose sums may be taken in any order."""
EXACT: dict[str, Any] = {"cache": True, "nogil": True}
"""How numba compiles a kernel for :func:`in_parallel` that rounds as it is written."""


SHARES = 2
"""Of what is left when a range is handed out, a thread's share is cut into so many."""


def _available() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        return os.cpu_count() or 1


class _Pool:
    """One pool per process, made when first needed and made anew after a fork."""

    def __init__(self) -> None:
        self.executor: ThreadPoolExecutor | None = None
        self.lock = threading.Lock()

    def submit(self, task: Callable[[], R]) -> Future[R]:
        with self.lock:
            if self.executor is None:
                self.executor = ThreadPoolExecutor(_available(), thread_name_prefix="unveil")
            return self.executor.submit(task)

    def forget(self) -> None:
        self.executor, self.lock = None, threading.Lock()


class _Share:
    """What a helper does of a kernel's work, unless it is done before the helper wakes up."""

    def __init__(self, work: Callable[[], None]) -> None:
        self.work = work
        self.failure: BaseException | None = None
        self.free, self.busy = threading.Lock(), threading.Lock()
        self.busy.acquire()

    def do(self) -> None:
        if not self.free.acquire(blocking=False):
            return
        try:
            self.work()
        except BaseException as error:
            self.failure = error
        finally:
            self.busy.release()

    def end(self) -> BaseException | None:
        """Wait until nobody works on it; returns what went wrong."""
        if not self.free.acquire(blocking=False):
            self.busy.acquire()
        return self.failure


class _Helpers:
    """Threads that take shares. A future would cost more than the smallest kernels take."""

    def __init__(self) -> None:
        self.forget()

    def give(self, shares: Sequence[_Share]) -> None:
        while len(self.threads) < min(len(shares), _available()):
            self.threads.append(threading.Thread(target=self._help, args=(self.queue,), name="unveil", daemon=True))
            self.threads[-1].start()
        for share in shares:
            self.queue.put(share)

    @staticmethod
    def _help(queue: SimpleQueue[_Share]) -> None:
        while True:
            queue.get().do()

    def forget(self) -> None:
        self.queue, self.threads = SimpleQueue[_Share](), list[threading.Thread]()


_pool, _helpers = _Pool(), _Helpers()
_processors = _available()
_count, _alone = ContextVar("count", default=_processors), ContextVar("alone", default=False)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.forget)
    os.register_at_fork(after_in_child=_helpers.forget)


def thread_count() -> int:
    """How many threads share the work: the processors this process may use, unless :func:`threads` says otherwise."""
    return _count.get()


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Use this number of threads within the block."""
    before = _count.set(max(1, count))
    try:
        yield
    finally:
        _count.reset(before)


def in_context(work: Callable[P, R]) -> Callable[P, R]:
    """The same work, once, for a thread that is started for it: in a copy of the caller's context as it is now."""
    return partial(copy_context().run, work)


def in_parallel(kernel: Callable[..., Any], size: int, chunk: int, *arguments: Any) -> None:
    """Call ``kernel(start, stop, *arguments)`` for consecutive chunks of ``range(size)``.

    Args:
        kernel: compiled without the interpreter's lock; its chunks must not depend on one another.
        size: how much there is; chunk: how much a thread takes at a time.
    """
    chunks = -(-size // chunk)
    helpers = 0 if works_alone() else min(thread_count(), chunks) - 1
    if helpers < 1:
        if size > 0:
            kernel(0, size, *arguments)
        return
    ranges = _ranges(size, chunk, helpers + 1)
    turn = itertools.count()

    def work() -> None:
        while (k := next(turn)) < len(ranges):
            kernel(*ranges[k], *arguments)

    shares = [_Share(in_context(work)) for _ in range(helpers)]
    _helpers.give(shares)
    try:
        work()
    finally:
        # Nothing may still be writing when this returns, not even after an error here.
        failures = [share.end() for share in shares]
    for failure in failures:
        if failure is not None:
            raise failure


@lru_cache(maxsize=512)
def _ranges(size: int, chunk: int, count: int) -> tuple[tuple[int, int], ...]:
    """Ranges of whole chunks for ``count`` threads, in the order in which they are handed out."""
    found, start = [], 0
    while start < size:
        left = -(-(size - start) // chunk)
        stop = min(size, start + chunk * max(1, left // (SHARES * count)))
        found.append((start, stop))
        start = stop
    return tuple(found)


def works_alone() -> bool:
    """Whether this thread works on one item of :func:`each`: what it calls must not wait for other threads of the pool."""
    return _alone.get()


def each(work: Callable[[T], R], items: Sequence[T], *, most: int | None = None) -> Iterator[R]:
    """``work(item)`` of each item, in their order, several at a time.

    Args:
        work: must not depend on what is made of other items. Where one fails, those after it may have begun; they are waited for.
        items: no more than one per thread, and one, are ahead of what was taken.
        most: items at work at a time, as memory allows; None = one per thread.
    """
    count = min(thread_count(), len(items), len(items) if most is None else most)
    if count < 2 or works_alone():
        yield from map(work, items)
        return

    context = copy_context()
    context.run(_alone.set, True)
    begun: deque[Future[R]] = deque()
    try:
        for item in items:
            if len(begun) > count:
                yield begun.popleft().result()
            begun.append(_pool.submit(partial(context.copy().run, work, item)))
        while begun:
            yield begun.popleft().result()
    finally:
        # Nothing may still be at work when this ends, not even after an error or where no more is asked for.
        for future in begun:
            if not future.cancel():
                future.exception()
