"""Work shared out between threads: everything once, errors not lost, and the same after a fork."""

from __future__ import annotations

import os
import threading
import time

import numpy as np
import pytest

from unveil_core.base.parallel import each, in_parallel, thread_count, threads, works_alone


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


@pytest.mark.parametrize("count", [2, 5])
def test_ranges_are_whole_chunks_and_fewer_than_these(count: int) -> None:
    seen = []

    def kernel(start: int, stop: int) -> None:
        seen.append((start, stop))

    with threads(count):
        in_parallel(kernel, 10_001, 10)
    assert all(start % 10 == 0 and (stop % 10 == 0 or stop == 10_001) for start, stop in seen)
    assert sum(stop - start for start, stop in seen) == 10_001
    assert count < len(seen) < 100


def test_helpers_at_other_work_are_not_waited_for() -> None:
    """Two threads ask for help at once, and all helpers are held by the first: the second does everything itself."""
    release, held = threading.Event(), threading.Semaphore(0)

    def waiting(start: int, stop: int) -> None:
        held.release()
        release.wait(120)

    many = (os.cpu_count() or 1) + 2
    with threads(many):
        first = threading.Thread(target=in_parallel, args=(waiting, many, 1))
        first.start()
        try:
            for _ in range(2):
                assert held.acquire(timeout=60)
            time.sleep(0.05)
            done = np.zeros(50, int)
            in_parallel(lambda a, b: done.__setitem__(slice(a, b), 1), 50, 1)
            assert done.all() and not release.is_set()
        finally:
            release.set()
            first.join()


def test_an_error_in_any_thread_arrives_after_all_have_stopped() -> None:
    running = threading.Semaphore(0)

    def kernel(start: int, stop: int) -> None:
        if threading.current_thread() is not threading.main_thread():
            running.release()
            raise RuntimeError("broken chunk")
        running.acquire(timeout=60)

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


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("most", [None, 1, 2])
def test_items_come_in_their_order_with_no_more_at_work_than_asked_for(count: int, most: int | None) -> None:
    lock, now, highest = threading.Lock(), [0], [0]

    def work(item: int) -> int:
        with lock:
            now[0] += 1
            highest[0] = max(highest[0], now[0])
        time.sleep(0.001 * (item % 3))
        with lock:
            now[0] -= 1
        return item * item

    with threads(count):
        assert list(each(work, range(20), most=most)) == [k * k for k in range(20)]
    assert highest[0] <= min(count, most or count)
    assert list(each(work, [])) == []


def test_kernels_within_an_item_stay_in_its_thread() -> None:
    """Were they handed to the pool, whose threads all wait for them, nothing would ever end."""
    out = np.zeros((8, 1000), int)

    def work(row: int) -> bool:
        in_parallel(lambda a, b: out[row].__setitem__(slice(a, b), row + 1), 1000, 10)
        return works_alone()

    with threads(4):
        assert all(each(work, range(8)))
    assert (out == np.arange(1, 9)[:, None]).all() and not works_alone()


def test_an_error_in_an_item_arrives_after_all_others_have_stopped() -> None:
    now = set()

    def work(item: int) -> None:
        now.add(item)
        try:
            if item == 1:
                raise RuntimeError("broken item")
            time.sleep(0.02)
        finally:
            now.discard(item)

    with threads(3), pytest.raises(RuntimeError, match="broken item"):
        list(each(work, range(50)))
    assert not now


def test_who_stops_asking_is_not_left_with_threads_at_work() -> None:
    begun, ended = [], []

    def work(item: int) -> int:
        begun.append(item)
        time.sleep(0.01)
        ended.append(item)
        return item

    with threads(2):
        for item in each(work, range(100)):
            if item == 3:
                break
        assert sorted(begun) == sorted(ended) and len(begun) < 12
