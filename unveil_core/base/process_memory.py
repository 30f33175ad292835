"""Memory of this process: its peak, and giving back what is free."""

from __future__ import annotations

import ctypes
import gc
import platform
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import psutil

__all__ = ["free_cycles", "old_objects_set_aside", "peak_memory_mb", "return_free_memory"]


def peak_memory_mb() -> float:
    """Largest resident size of this process so far, MB."""
    try:
        import resource
    except ImportError:  # Windows
        info = psutil.Process().memory_info()
        return round(getattr(info, "peak_wset", info.rss) / 2**20, 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if platform.system() == "Darwin" else 2**10), 1)


@cache
def _c_library() -> ctypes.CDLL | None:
    """The C library where it is one that keeps what is freed, glibc; else None."""
    if platform.libc_ver()[0] != "glibc":
        return None
    library = ctypes.CDLL(None)
    return library if hasattr(library, "malloc_trim") else None


def return_free_memory() -> None:
    """Give memory that was freed back to the system.

    glibc keeps what lies between pieces in use. Pictures of a few megabytes come and go by the thousand, and the gaps
    add up. Takes some milliseconds; does nothing where the C library is another.
    """
    library = _c_library()
    if library is not None:
        library.malloc_trim(0)


class _SetAside:
    """How many blocks are at work, in all threads: what the collector passes over belongs to the process."""

    def __init__(self) -> None:
        self.lock, self.blocks, self.by_caller = threading.Lock(), 0, False


_aside = _SetAside()


@contextmanager
def old_objects_set_aside() -> Iterator[None]:
    """Within it :func:`free_cycles` looks through new objects alone.

    Modules and their functions are half a million objects: looking through them would take longer than many a stage does.
    """
    with _aside.lock:
        if not _aside.blocks:
            _aside.by_caller = gc.get_freeze_count() > 0
        _aside.blocks += 1
    gc.freeze()
    try:
        yield
    finally:
        with _aside.lock:
            _aside.blocks -= 1
            if not _aside.blocks and not _aside.by_caller:
                gc.unfreeze()


def free_cycles() -> None:
    """Free objects that only refer to each other. What is alive counts as old from now on."""
    gc.collect()
    gc.freeze()
