"""Freeing objects that only refer to each other, without looking through all others."""

from __future__ import annotations

import gc
import weakref

from unveil_core.base.process_memory import free_cycles, old_objects_set_aside


class Ring:
    """Refers to itself."""

    def __init__(self) -> None:
        self.itself = self


def test_new_cycles_are_freed_and_what_lives_is_old_from_then_on() -> None:
    with old_objects_set_aside():
        ring, kept = Ring(), Ring()
        gone = weakref.ref(ring)
        del ring
        free_cycles()
        assert gone() is None and kept.itself is kept
        assert not any(thing is kept for thing in gc.get_objects()), "it is looked through again"
    assert gc.get_freeze_count() == 0
    old = weakref.ref(kept)
    del kept
    gc.collect()
    assert old() is None


def test_what_the_caller_set_aside_stays_so() -> None:
    gc.freeze()
    try:
        with old_objects_set_aside():
            pass
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()


def test_of_two_at_once_the_last_one_puts_back() -> None:
    first, second = old_objects_set_aside(), old_objects_set_aside()
    with first:
        second.__enter__()
        free_cycles()
    assert gc.get_freeze_count() > 0, "the second is still at work"
    free_cycles()
    second.__exit__(None, None, None)
    assert gc.get_freeze_count() == 0
