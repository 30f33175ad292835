"""Where a pixel of the empty street, or a surfel, has its colour from.

The numbers are those of ``provenance/`` in a workspace, in order of trust.
"""

from __future__ import annotations

__all__ = ["CONTINUED", "INVENTED", "ORIGINAL", "ORIGIN_COUNT", "RELIT", "SEEN_ELSEWHERE"]

ORIGINAL, RELIT, SEEN_ELSEWHERE, CONTINUED, INVENTED = 0, 1, 2, 3, 4
"""The photograph itself; a photograph from which a shadow was taken; another frame; what was seen of the street, the facade, the
pole or the surface beside it, continued; the single-image inpainter."""
ORIGIN_COUNT = 5
