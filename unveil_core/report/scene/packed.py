"""Splats as the page's text carries them: five 32-bit words each, least significant bits first.

====== ======================================================================================================================
words  what
====== ======================================================================================================================
0, 1   x, y, z: 21 bits each, steps from the lowest corner; of a kilometre half a millimetre
2      rotation: the three smaller of x y z w, 9 bits and a sign each, and which is left out, as SPZ has it
3      red, green, blue, opacity: 8 bits each
4      two scales: 14 bits each of their logarithm, 0.1 % a step; where the colour comes from: 4 bits
====== ======================================================================================================================
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.exports.splats.spz import packed_rotations
from unveil_core.report.scene.splats import Splats

__all__ = ["LOG_SCALES", "PLACE_BITS", "packed", "packed_text"]

PLACE_BITS = 21
SCALE_BITS = 14
LOG_SCALES = (-12.0, 5.0)
"""From 6 micrometres to 148 metres."""


def packed_text(splats: Splats) -> tuple[str, dict[str, Any]]:
    """Base64 of :func:`packed`, and what is needed to read it: ``low`` (3,) and ``step``, both metres, and ``count``."""
    words, low, step = packed(splats)
    told = {"count": len(splats), "low": [float(v) for v in low], "step": step}
    return base64.b64encode(words.astype("<u4").tobytes()).decode("ascii"), told


def packed(splats: Splats) -> tuple[NDArray[np.uint32], NDArray[np.float64], float]:
    """(N, 5) words; the lowest corner (3,) and the step of places, metres."""
    places = splats.means.astype(np.float64)
    low = places.min(axis=0) if len(places) else np.zeros(3)
    step = max(float((places - low).max(initial=0.0)), 1e-3) / (2**PLACE_BITS - 1)
    x, y, z = np.round((places - low) / step).astype(np.uint64).T
    place = x | (y << np.uint64(PLACE_BITS)) | (z << np.uint64(2 * PLACE_BITS))
    share = (np.clip(splats.log_scales, *LOG_SCALES) - LOG_SCALES[0]) / (LOG_SCALES[1] - LOG_SCALES[0])
    scales = np.round(share * (2**SCALE_BITS - 1)).astype(np.uint32)
    shades = np.column_stack([splats.colors, splats.opacities])
    words = np.empty((len(splats), 5), np.uint32)
    words[:, 0], words[:, 1] = place & np.uint64(0xFFFFFFFF), place >> np.uint64(32)
    words[:, 2] = np.frombuffer(packed_rotations(splats.quats.astype(np.float64)), "<u4")
    words[:, 3] = np.round(np.clip(shades, 0, 1) * 255).astype(np.uint8).view("<u4")[:, 0]
    words[:, 4] = scales[:, 0] | (scales[:, 1] << SCALE_BITS) | (splats.origins.astype(np.uint32) << 2 * SCALE_BITS)
    return words, low, step
