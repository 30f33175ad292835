# SPDX-License-Identifier: GPL-3.0-or-later
"""How many of points and Gaussians a scene shows. No bpy here."""

from __future__ import annotations

import numpy as np

__all__ = ["fair_share"]


def fair_share(count: int, most: int, seed: int = 0) -> np.ndarray:
    """Indices of at most so many of ``count`` things, picked evenly, in order."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))
