"""Numbers as people read them, the same on the page and in the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from unveil_core.evaluate import METHODS
from unveil_core.evaluate.detail.scores import SPECTRUM_FIGURES
from unveil_core.evaluate.detail.spectrum import BANDS_PX

__all__ = [
    "WAVELENGTHS",
    "decibels",
    "detail",
    "detail_rows",
    "left_most",
    "memory",
    "movers",
    "percent",
    "seconds",
    "similarity",
    "spectrum",
]

WAVELENGTHS = {name: f"{px // 2} to {px} px" for name, px in zip(SPECTRUM_FIGURES, BANDS_PX, strict=True)}
"""The bands of the spectrum by the names of their figures."""
MOST_LEFT = 3
"""Objects that are named for what is left of them."""


def decibels(value: float | None) -> str:
    """``31.4 dB``; None for images that agree exactly."""
    return "exact" if value is None else f"{value:.1f} dB"


def similarity(value: float | None) -> str:
    """SSIM with three digits."""
    return "–" if value is None else f"{value:.3f}"


def detail(name: str, value: float | None) -> str:
    """A figure of ``evaluate.detail``: gradient and spectrum as ratios, shares in per cent; a dash where there was nothing to
    compare."""
    if value is None:
        return "–"
    return f"{value:.2f}" if name in ("gradient", *SPECTRUM_FIGURES) else percent(value)


def spectrum(figures: Mapping[str, Any]) -> str:
    """``0.85 (2 to 4 px), …`` of those bands that are known; empty where none is."""
    known = {band: figures.get(name) for name, band in WAVELENGTHS.items()}
    return ", ".join(f"{value:.2f} ({band})" for band, value in known.items() if value is not None)


def detail_rows(truth: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The figures of ``evaluate.detail`` by row: each method where something was removed, and ours in cast shadows.

    Args:
        truth: the ``truth`` of metrics.json. Metrics of an earlier version have no such figures, and no rows.
    """

    def figures(region: str, method: str) -> dict[str, Any]:
        found: dict[str, Any] = truth.get("regions", {}).get(region, {}).get("methods", {}).get(method, {})
        return found

    rows = {name: figures("removed", method) for method, name in METHODS.items()}
    rows[f"{METHODS['ours']}, in cast shadows"] = figures("cast_shadow", "ours")
    return {name: values for name, values in rows.items() if "gradient" in values}


def left_most(truth: dict[str, Any]) -> str:
    """``car 3 (1.1 %), car 2 (0.4 %)``: the objects of which most is left, and which share of their pixels; may be empty.

    Args:
        truth: the ``truth`` of metrics.json.
    """
    objects = [entry for entry in truth.get("residue_by_object", []) if entry["left"]][:MOST_LEFT]
    return ", ".join(f"{entry['class']} {entry['id']} ({percent(entry['residue'])})" for entry in objects)


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
