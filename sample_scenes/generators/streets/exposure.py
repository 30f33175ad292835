"""From linear light to 8-bit pictures: one exposure for a street, which drifts in some, and a soft shoulder."""

from __future__ import annotations

import math

import numpy as np

from sample_scenes.generators.streets.plan import Light

SHOULDER = 0.72
"""Linear level from which highlights are compressed; 1 is never passed."""
SUNLIT_SHARE = 0.5


def encode(light: np.ndarray, gain: float) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of linear light."""
    x = np.maximum(light * gain, 0.0)
    room = 1 - SHOULDER
    x = np.where(x > SHOULDER, SHOULDER + room * (1 - np.exp(-(x - SHOULDER) / room)), x)
    srgb = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)
    return np.round(np.clip(srgb, 0, 1) * 255).astype(np.uint8)


def base_gain(pictures: list[np.ndarray], brightness: float) -> float:
    """The gain at which the pictures' mean level is ``brightness``, by bisection."""
    sample = np.concatenate([p[::6, ::6].reshape(-1, 3) for p in pictures])[None]
    low, high = 1e-3, 1e3
    for _ in range(30):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if encode(sample, middle).mean() / 255 > brightness else (middle, high)
    return math.sqrt(low * high)


def gains(light: Light, seed: int, count: int, base: float) -> np.ndarray:
    """(F,) gain of each station: smooth, ``drift`` stops strong."""
    if not light.drift:
        return np.full(count, base)
    rng = np.random.default_rng([seed, 4])
    phase, pace = rng.uniform(0, 2 * math.pi, 3), np.array([0.21, 0.53, 1.3])
    frames = np.arange(count)[:, None]
    wave = (np.sin(frames * pace + phase) * (0.6, 0.35, 0.2)).sum(axis=1) + rng.normal(0, 0.08, count)
    found: np.ndarray = base * 2.0 ** (light.drift * wave)
    return found
