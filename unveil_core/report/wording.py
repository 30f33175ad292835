"""Numbers as people read them, the same on the page and in the terminal."""

from __future__ import annotations

from typing import Any

__all__ = ["decibels", "memory", "movers", "percent", "seconds", "similarity"]


def decibels(value: float | None) -> str:
    """``31.4 dB``; None for images that agree exactly."""
    return "exact" if value is None else f"{value:.1f} dB"


def similarity(value: float | None) -> str:
    """SSIM with three digits."""
    return "–" if value is None else f"{value:.3f}"


def percent(share: float) -> str:
    """A share of one in per cent; small ones keep a digit."""
    return f"{100 * share:.0f} %" if share >= 0.1 or share == 0 else f"{100 * share:.1f} %"


def seconds(value: float) -> str:
    """``0.04 s``, ``8.2 s``, ``43 s``, ``3 min 05 s``, ``1 h 12 min``."""
    if value < 0.995:
        return f"{value:.2f} s"
    if value < 9.95:
        return f"{value:.1f} s"
    whole = round(value)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    minutes = round(value / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min"


def memory(megabytes: float) -> str:
    """``640 MB`` or ``2.3 GB``."""
    return f"{megabytes:.0f} MB" if megabytes < 1000 else f"{megabytes / 1024:.1f} GB"


def movers(state: dict[str, Any]) -> tuple[int, str]:
    """Number of dynamic objects in workspace.json, and the rest of a sentence that begins with it."""
    count = state.get("stages", {}).get("segment", {}).get("movers", 0)
    if not isinstance(count, int) or count < 1:
        return 0, ""
    return (
        count,
        "dynamic object, removed from every frame" if count == 1 else "dynamic objects, removed from every frame",
    )
