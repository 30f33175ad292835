"""Settings that must be made before anything is imported."""

from __future__ import annotations

import os
from pathlib import Path

# How long stages take is kept for forecasts: of the tests', nothing in the user's folders.
here = Path(__file__).parents[1] / ".pytest_cache/forecast"
os.environ["UNVEIL_CACHE"] = str(here / os.environ.get("PYTEST_XDIST_WORKER", "main"))

# Kernels are compiled once for all processes of the tests, and not beside the source, which may be read-only.
os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache/kernels"))

# A studio's colours are for tests that set them.
os.environ.pop("OCIO", None)

import torch  # noqa: E402

if not torch.cuda.is_available():
    # Triton's kernels run in its interpreter, on the processor, exactly as written.
    os.environ.setdefault("TRITON_INTERPRET", "1")

from hypothesis import settings  # noqa: E402

# The first example of a kernel waits for its compilation, and machines have other work.
settings.register_profile("unveil", deadline=None)
settings.load_profile("unveil")
