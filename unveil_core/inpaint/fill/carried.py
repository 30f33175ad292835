"""A surface along the street carried to where nobody saw it: its lines, and the rest by kriging."""

from __future__ import annotations

import numpy as np

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.fields.kriging import kriged
from unveil_core.inpaint.fill.lateral_lines import lateral_lines

__all__ = ["carried_surface"]


def carried_surface(color: Float32, known: Mask, texel: float) -> tuple[Float32, Float32]:
    """(A, B, 3) the surface everywhere, no brighter than what is known or white, 1; and (A, B, 3) where it is known what is
    finer than that: texture.

    Args:
        color: (A, B, 3), rows along the street; known: (A, B) texels whose colours count; texel: side of a texel, metres.
    """
    lines = lateral_lines(color, known, texel) if on("lateral_lines") else np.zeros_like(color)
    carried = kriged(color - lines, known, texel)
    fine = np.where(known[..., None], color - lines - carried.broad, 0).astype(np.float32)
    brightest = color.max(initial=1.0, where=known[..., None])
    return np.clip(carried.all + lines, 0, brightest).astype(np.float32), fine
