"""Memory of this process: its peak, and giving back what is free."""

from __future__ import annotations

import ctypes
import platform
from functools import cache

import psutil

__all__ = ["peak_memory_mb", "return_free_memory"]


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
