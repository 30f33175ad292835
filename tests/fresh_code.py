"""The same program with kernels that it compiles itself and with kernels from the cache."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def told_fresh_and_cached(program: str, cache: Path) -> list[str]:
    """What a Python program prints in a process that compiles the kernels, and in one that loads them.

    Args:
        program: source; cache: an empty folder for the kernels.
    """
    told = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=240,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        told.append(done.stdout)
    assert list(cache.rglob("*.nbc"))
    return told
