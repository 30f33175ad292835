"""Work shared out between threads: everything once, errors not lost, and the same after a fork."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from unveil_core.base.parallel import in_parallel, thread_count, threads


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize(("size", "chunk"), [(0, 4), (1, 4), (4, 4), (1001, 7)])
def test_every_index_is_done_once(count: int, size: int, chunk: int) -> None:
    done = np.zeros(size, int)

    def kernel(start: int, stop: int, into: np.ndarray) -> None:
        assert start < stop
        into[start:stop] += 1

    with threads(count):
        in_parallel(kernel, size, chunk, done)
    assert (done == 1).all()


def test_an_error_in_any_thread_arrives_after_all_have_stopped() -> None:
    running = threading.Semaphore(0)

    def kernel(start: int, stop: int) -> None:
        if threading.current_thread() is not threading.main_thread():
            running.release()
            raise RuntimeError("broken chunk")
        running.acquire(timeout=10)

    with threads(2), pytest.raises(RuntimeError, match="broken chunk"):
        in_parallel(kernel, 2, 1)


def test_the_number_of_threads_is_put_back() -> None:
    before = thread_count()
    with threads(before + 3):
        assert thread_count() == before + 3
    assert thread_count() == before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_child_makes_threads_of_its_own() -> None:
    out = np.zeros(64, int)
    with threads(2):
        in_parallel(lambda a, b: out.__setitem__(slice(a, b), 1), 64, 1)
        child = os.fork()
        if child == 0:  # the parent's threads do not exist here
            in_parallel(lambda a, b: out.__setitem__(slice(a, b), 2), 64, 1)
            os._exit(0 if (out == 2).all() else 1)
    assert os.waitpid(child, 0)[1] == 0
