"""Peak memory of this process."""

from __future__ import annotations

import platform

import psutil

__all__ = ["peak_memory_mb"]


def peak_memory_mb() -> float:
    """Largest resident size of this process so far, MB."""
    try:
        import resource
    except ImportError:  # Windows
        info = psutil.Process().memory_info()
        return round(getattr(info, "peak_wset", info.rss) / 2**20, 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if platform.system() == "Darwin" else 2**10), 1)
