"""Peak memory of this process, where the system reports it."""

from __future__ import annotations

import platform

__all__ = ["peak_memory_mb"]


def peak_memory_mb() -> float | None:
    """Largest resident size of this process so far, MB; None where Python cannot ask the system for it (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if platform.system() == "Darwin" else 2**10), 1)
