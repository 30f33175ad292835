"""About how long a solve takes, from how much there is to do."""

from __future__ import annotations

__all__ = ["LONGEST_SIDE", "about_seconds", "seconds_of_frames"]

COST_S = {"frames": 0.12, "features": 0.35, "pairs": 0.016, "mapping": 0.09, "points": 0.75}
"""Seconds on one core: of taking and looking at a megapixel of a frame; of features a megapixel, of a pair, of mapping a frame, of
points a megapixel looked at."""
LONGEST_SIDE, LOOKED_SIDE = 2400, 1280
"""Pixels at which features, and points, are found at most."""
THOROUGH = 4


def about_seconds(chosen: int, size: tuple[int, int], pairs: int, thorough: bool) -> float:
    """Seconds from the features on.

    Args:
        chosen: frames that are solved; pairs: of those that are matched.
        size: width and height, pixels; thorough: as in the settings.
    """
    more = THOROUGH if thorough else 1
    seconds = more * (chosen * _megapixels(size, LONGEST_SIDE) * COST_S["features"] + pairs * COST_S["pairs"])
    return seconds + chosen * (COST_S["mapping"] + _megapixels(size, LOOKED_SIDE) * COST_S["points"])


def seconds_of_frames(frames: int, size: tuple[int, int]) -> float:
    """Seconds until frames are decoded and looked at."""
    return frames * size[0] * size[1] / 1e6 * COST_S["frames"]


def _megapixels(size: tuple[int, int], longest: int) -> float:
    return size[0] * size[1] / 1e6 * min(1.0, longest / max(size)) ** 2
