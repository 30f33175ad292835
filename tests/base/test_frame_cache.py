"""Pictures by frame: made when asked for, held within the room that there is, and the same however much that is."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.base.frame_cache import FrameCache, Frames, nbytes_of, subset
from unveil_core.base.parallel import each, threads

PICTURE_BYTES = 800


class Maker:
    """Pictures of 800 bytes, and how often each was made."""

    def __init__(self) -> None:
        self.made: list[int] = []

    def __call__(self, i: int) -> np.ndarray:
        self.made.append(i)
        return np.full(100, float(i))


@given(st.lists(st.integers(0, 9), max_size=60), st.integers(0, 12))
def test_values_do_not_depend_on_the_room_and_the_room_is_kept(asked: list[int], room: int) -> None:
    cache, make = FrameCache(room * PICTURE_BYTES), Maker()
    frames = cache.frames(10, make)
    for i in asked:
        assert frames[i][0] == i
        assert cache.nbytes <= max(room, 1) * PICTURE_BYTES
    if room >= 10:
        assert sorted(make.made) == sorted(set(asked))


def test_what_was_used_last_stays() -> None:
    cache, make = FrameCache(2 * PICTURE_BYTES), Maker()
    frames = cache.frames(3, make)
    for i in (0, 1, 0, 2, 0, 1):
        frames[i]
    assert make.made == [0, 1, 2, 1]


def test_sequences_share_the_room_and_give_it_back() -> None:
    cache = FrameCache(10 * PICTURE_BYTES)
    kept, gone = cache.frames(2, Maker()), cache.frames(2, Maker())
    list(kept), list(gone)
    assert cache.nbytes == 4 * PICTURE_BYTES
    del gone
    gc.collect()
    assert cache.nbytes == 2 * PICTURE_BYTES


def test_frames_are_a_sequence() -> None:
    frames = Frames(6, lambda i: i * i)
    assert len(frames) == 6 and list(frames) == [0, 1, 4, 9, 16, 25] and frames[-1] == 25
    assert list(frames[1::2]) == [1, 9, 25] and list(frames[1::2][1:]) == [9, 25]
    for wrong in (6, -7):
        try:
            frames[wrong]
        except IndexError:
            continue
        raise AssertionError("no such frame")


def test_some_frames_are_those_frames() -> None:
    some = subset(Frames(9, lambda i: 10 * i), (7, 2, 2))
    assert list(some) == [70, 20, 20] and len(some) == 3


def test_what_is_stored_is_computed_once(tmp_path: Path) -> None:
    calls: list[int] = []

    def make(i: int) -> tuple[np.ndarray, ...]:
        calls.append(i)
        return np.arange(i + 3, dtype=np.float16), np.array([i % 2 == 0]), np.zeros((0, 3))

    frames = FrameCache(0).stored(tmp_path / "planes", 4, make)
    for _ in range(3):
        for i in (3, 0, 2):
            numbers, even, nothing = frames[i]
            assert numbers.dtype == np.float16 and numbers.tolist() == list(range(i + 3))
            assert even.tolist() == [i % 2 == 0] and nothing.shape == (0, 3)
    assert calls == [3, 0, 2]


def test_the_size_of_what_is_held() -> None:
    picture: Callable[[], np.ndarray] = lambda: np.zeros(100)  # noqa: E731
    assert nbytes_of(picture()) == 800 and nbytes_of((picture(), [picture(), "name"])) == 1600 and nbytes_of(None) == 0


def test_of_threads_that_ask_for_one_value_at_once_one_makes_it() -> None:
    cache, made = FrameCache(), []

    def make(i: int) -> np.ndarray:
        made.append(i)
        time.sleep(0.01)
        return np.full(10, float(i))

    frames = cache.frames(3, make)
    with threads(4):
        assert list(each(lambda k: float(frames[k % 3][0]), range(30))) == [float(k % 3) for k in range(30)]
    assert sorted(made) == [0, 1, 2]
