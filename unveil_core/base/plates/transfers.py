"""Encodings of light in plates, and their inverses: float64 arrays of any shape, 1 = white of the encoding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.base.types import Float64

__all__ = ["TRANSFERS"]

BLACK, WHITE = 95.0, 685.0
"""Codes of 10 bits of Kodak's Cineon encoding."""
DENSITY, GAMMA, TOP = 0.002, 0.6, 1023.0
"""Printing density of a code, gamma of the negative, and the largest code."""
OFFSET = 10 ** ((BLACK - WHITE) * DENSITY / GAMMA)
LEAST = 1e-6
"""Of what a logarithm is taken."""


def _from_log(codes: Float64) -> Float64:
    return np.asarray((10 ** ((codes * TOP - WHITE) * DENSITY / GAMMA) - OFFSET) / (1 - OFFSET))


def _to_log(light: Float64) -> Float64:
    inner = np.maximum(light * (1 - OFFSET) + OFFSET, LEAST)
    return np.asarray((WHITE + np.log10(inner) * GAMMA / DENSITY) / TOP)


def _from_video(codes: Float64) -> Float64:
    return np.where(codes < 0.081, codes / 4.5, ((np.maximum(codes, 0) + 0.099) / 1.099) ** (1 / 0.45))


def _to_video(light: Float64) -> Float64:
    return np.where(light < 0.018, light * 4.5, 1.099 * np.maximum(light, 0) ** 0.45 - 0.099)


def _same(values: Float64) -> Float64:
    return np.asarray(values, dtype=np.float64)


TRANSFERS: dict[str, tuple[Callable[[Float64], Float64], Callable[[Float64], Float64]]] = {
    "linear": (_same, _same),
    "log": (_from_log, _to_log),
    "rec709": (_from_video, _to_video),
    "srgb": (linear_of_srgb, srgb_of_linear),
}
"""By name: to light, and back. ``log`` is Cineon's printing density, ``rec709`` the camera curve of ITU-R BT.709."""
