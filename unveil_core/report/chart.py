"""The one chart of the page: error per frame, as a small SVG."""

from __future__ import annotations

import math
from typing import Any

from unveil_core.evaluate import METHODS

__all__ = ["psnr_chart"]

SERIES = {"ours": "--ours", "shift_map": "--second", "telea": "--third", "input": "--fourth"}
WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 1000, 220, 44, 24, 8


def psnr_chart(per_frame: list[dict[str, Any]]) -> dict[str, Any] | None:
    """PSNR in the removed region over the frames, as the template draws it; None where fewer than two frames have one."""
    scored = [entry for entry in per_frame if entry.get("psnr")]
    values = [v for e in scored for m, v in e["psnr"].items() if m in SERIES and v is not None]
    if len(scored) < 2 or not values:
        return None
    low, high = 5 * math.floor(min(values) / 5), 5 * math.ceil(max(values) / 5)
    high = max(high, low + 5)
    step = 5 if high - low <= 30 else 10

    def x(i: int) -> float:
        return float(LEFT + (WIDTH - LEFT - 6) * i / (len(scored) - 1))

    def y(value: float) -> float:
        return float(TOP + (HEIGHT - TOP - BOTTOM) * (high - value) / (high - low))

    def points(method: str) -> str:
        known = ((i, e["psnr"].get(method)) for i, e in enumerate(scored))
        return " ".join(f"{x(i):.1f},{y(value):.1f}" for i, value in known if value is not None)

    shown = [m for m in SERIES if any(e["psnr"].get(m) is not None for e in scored)]
    levels = range(low, high + 1, step)
    ends = ((0, "start"), (len(scored) - 1, "end"))
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "left": LEFT,
        "label": "PSNR in decibels where something was removed, frame by frame",
        "levels": [{"decibels": d, "y": f"{y(d):.1f}", "text_y": f"{y(d) + 4:.1f}"} for d in levels],
        "ends": [{"x": f"{x(i):.1f}", "anchor": anchor, "name": str(scored[i].get("frame", ""))} for i, anchor in ends],
        "lines": [{"points": points(m), "color": SERIES[m]} for m in reversed(shown)],
        "legend": [(f"var({SERIES[m]})", METHODS[m]) for m in shown],
    }
