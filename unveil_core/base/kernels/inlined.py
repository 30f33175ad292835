"""How a part of several kernels is compiled."""

from __future__ import annotations

from typing import Any

from unveil_core.base.parallel import FAST

__all__ = ["INLINED"]

INLINED: dict[str, Any] = {**FAST, "cache": False, "forceinline": True}
"""Of a part that kernels as of ``FAST`` call: into each of them. It is not kept for itself: numba's cache looks at a function's own
file alone, and would go on with what it was made of from others."""
