"""About how long a solve takes, from how much there is to do."""

from __future__ import annotations

__all__ = ["LONGEST_SIDE", "about_seconds", "seconds_by_step", "seconds_of_frames"]

COST_S = {"frames": 0.12, "features": 0.35, "pairs": 0.016, "mapping": 0.09, "points": 0.75}
"""Seconds on one core: of taking and looking at a megapixel of a frame; of features a megapixel, of a pair, of mapping a frame, of
points a megapixel looked at."""
LONGEST_SIDE, LOOKED_SIDE = 2400, 1280
"""Pixels at which features, and points, are found at most."""
THOROUGH = 4
DECODING = 0.6
"""Of the seconds until frames are looked at, the share of decoding."""


def seconds_by_step(frames: int, chosen: int, size: tuple[int, int], pairs: int, thorough: bool) -> dict[str, float]:
    """Seconds of each step, in order.

    Args:
        frames: of the footage; chosen: those of them that are solved; pairs: of those that are matched.
        size: width and height, pixels; thorough: as in the settings.
    """
    more, taken = THOROUGH if thorough else 1, seconds_of_frames(frames, size)
    return {
        "decode": DECODING * taken,
        "look": (1 - DECODING) * taken,
        "features": more * chosen * _megapixels(size, LONGEST_SIDE) * COST_S["features"],
        "match": more * pairs * COST_S["pairs"],
        "map": chosen * COST_S["mapping"],
        "rest": 0.0,
        "points": chosen * _megapixels(size, LOOKED_SIDE) * COST_S["points"],
    }


def about_seconds(chosen: int, size: tuple[int, int], pairs: int, thorough: bool) -> float:
    """Seconds from the features on; arguments as of :func:`seconds_by_step`."""
    return sum(seconds_by_step(0, chosen, size, pairs, thorough).values())


def seconds_of_frames(frames: int, size: tuple[int, int]) -> float:
    """Seconds until frames are decoded and looked at."""
    return frames * size[0] * size[1] / 1e6 * COST_S["frames"]


def _megapixels(size: tuple[int, int], longest: int) -> float:
    return size[0] * size[1] / 1e6 * min(1.0, longest / max(size)) ** 2
