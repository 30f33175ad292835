"""Settings that must be made before anything is imported."""

from __future__ import annotations

import os

import torch

if not torch.cuda.is_available():
    # Triton's kernels run in its interpreter, on the processor, exactly as written.
    os.environ.setdefault("TRITON_INTERPRET", "1")
