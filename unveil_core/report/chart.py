"""The one chart of the page: error per frame, as a small SVG."""

from __future__ import annotations

import math
from html import escape
from typing import Any

from unveil_core.evaluate import METHODS

__all__ = ["psnr_chart"]

SERIES = {"ours": "--ours", "shift_map": "--second", "telea": "--third", "input": "--fourth"}
WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 1000, 220, 44, 24, 8


def psnr_chart(per_frame: list[dict[str, Any]]) -> str:
    """PSNR in the removed region over the frames; empty text where fewer than two frames have one."""
    scored = [entry for entry in per_frame if entry.get("psnr")]
    values = [v for e in scored for m, v in e["psnr"].items() if m in SERIES and v is not None]
    if len(scored) < 2 or not values:
        return ""
    low, high = 5 * math.floor(min(values) / 5), 5 * math.ceil(max(values) / 5)
    high = max(high, low + 5)
    step = 5 if high - low <= 30 else 10

    def x(i: int) -> float:
        return float(LEFT + (WIDTH - LEFT - 6) * i / (len(scored) - 1))

    def y(value: float) -> float:
        return float(TOP + (HEIGHT - TOP - BOTTOM) * (high - value) / (high - low))

    parts = []
    for level in range(low, high + 1, step):
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH}" y1="{y(level):.1f}" y2="{y(level):.1f}"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y(level) + 4:.1f}" text-anchor="end">{level}</text>')
    for i, anchor in ((0, "start"), (len(scored) - 1, "end")):
        name = escape(str(scored[i].get("frame", "")))
        parts.append(f'<text x="{x(i):.1f}" y="{HEIGHT - 6}" text-anchor="{anchor}">{name}</text>')
    shown = [m for m in SERIES if any(e["psnr"].get(m) is not None for e in scored)]
    for method in reversed(shown):
        points = " ".join(
            f"{x(i):.1f},{y(e['psnr'][method]):.1f}" for i, e in enumerate(scored) if e["psnr"].get(method) is not None
        )
        parts.append(f'<polyline points="{points}" style="stroke:var({SERIES[method]})"/>')
    legend = "".join(f'<li><i style="background:var({SERIES[m]})"></i>{escape(METHODS[m])}</li>' for m in shown)
    label = "PSNR in decibels where something was removed, frame by frame"
    return (
        f'<div class="scroll"><svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg></div>"
        f'<ul class="legend">{legend}<li>{label}</li></ul>'
    )
