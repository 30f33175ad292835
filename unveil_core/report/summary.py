"""The closing lines of a run, for the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TextIO

from unveil_core.base.wording import shown
from unveil_core.evaluate import METHODS
from unveil_core.report.collect import read_json, understood
from unveil_core.report.provenance import certainty_cards
from unveil_core.report.wording import (
    decibels,
    detail,
    detail_rows,
    left_most,
    memory,
    movers,
    percent,
    seconds,
    similarity,
    spectrum,
)

__all__ = ["print_summary"]

RESULTS = (
    ("clean frames", "frames"),
    ("empty street, mesh", "meshes/empty.ply"),
    ("empty street, glTF", "meshes/empty.glb"),
    ("empty street, surfels", "surfels/empty.ply"),
    ("report", "report/index.html"),
    ("before and after", "report/before_after.mp4"),
)
COLUMNS = {"removed": "removed", "seen_elsewhere": "seen elsewhere", "unseen": "never seen"}
DETAILS = {
    "gradient": "gradient ratio",
    "line_recall": "lines found",
    "false_lines": "false lines",
    "residue": "residue",
}
"""Figures beside PSNR, and how the table calls them."""

FLICKERING = {name: METHODS.get(name, "the true street") for name in ("truth", "ours", "render", "telea", "shift_map")}


def print_summary(workspace_root: Path, file: TextIO) -> None:
    """Print where the results are, how good they are beside the baselines, and what each stage cost.

    Args:
        workspace_root: the workspace; what it does not have is left out.
        file: an open text stream.
    """
    root = Path(workspace_root)
    metrics, state = root / "metrics.json", root / "workspace.json"
    with understood(metrics):
        quality = _quality(read_json(metrics, {}))
    with understood(state):
        recorded = read_json(state, {})
        blocks = [_results(root), quality + _movers(recorded), _cost(recorded)]
    texts = ("\n".join(line if line.isprintable() else shown(line) for line in lines) for lines in blocks if lines)
    file.write("\n" + "\n\n".join(texts) + "\n")


def _results(root: Path) -> list[str]:
    return [f"  {name:<22} {root / where}" for name, where in RESULTS if (root / where).exists()]


def _quality(metrics: dict[str, Any]) -> list[str]:
    lines = []
    regions = metrics.get("truth", {}).get("regions", {})
    columns = [c for c in COLUMNS if c in regions]
    if columns:
        lines.append(f"  {'PSNR / SSIM to the true empty street':<38}" + "".join(f"{COLUMNS[c]:>18}" for c in columns))
        for method, name in METHODS.items():
            scores = [regions[c]["methods"].get(method) for c in columns]
            if any(scores):
                cells = (f"{decibels(s['psnr'])} / {similarity(s['ssim'])}" if s else "-" for s in scores)
                lines.append(f"    {name:<36}" + "".join(f"{cell:>18}" for cell in cells))
    free = metrics.get("free_views", {}).get("regions", {})
    if columns and free:
        scores = [free.get(f"free_{c}") for c in columns]
        cells = (f"{decibels(s['psnr'])} / {similarity(s['ssim'])}" if s else "-" for s in scores)
        lines.append(f"    {'rendered, beside and above the path':<36}" + "".join(f"{cell:>18}" for cell in cells))
    lines += _details(metrics.get("truth", {}))
    flicker = metrics.get("flicker", {}).get("methods", {})
    if flicker:
        parts = (f"{name} {flicker[m]['absolute']:.1f}" for m, name in FLICKERING.items() if m in flicker)
        lines.append(f"  flicker inside, levels of 255: {', '.join(parts)}")
    coverage = metrics.get("coverage", {})
    if coverage.get("removed") and coverage.get("unobserved_of_removed") is not None:
        lines.append(
            f"  {percent(coverage['removed'])} of all pixels were removed, "
            f"{percent(coverage['unobserved_of_removed'])} of these hidden in every frame"
        )
    lines += [f"  {share} {what}" for share, what in certainty_cards(metrics)]
    untouched = metrics.get("untouched", {})
    if "max" in untouched:
        change = "none" if untouched["max"] == 0 else f"up to {untouched['max']} of 255 levels"
        lines.append(f"  change outside the masks: {change}")
    return lines


def _details(truth: dict[str, Any]) -> list[str]:
    """What PSNR forgives in the removed region, a row for each method, and the objects of which most is left."""
    shown = detail_rows(truth)
    if not shown:
        return []
    lines = [f"  {'inside the removed region':<38}" + "".join(f"{title:>15}" for title in DETAILS.values())]
    for name, figures in shown.items():
        lines.append(f"    {name:<36}" + "".join(f"{detail(k, figures.get(k)):>15}" for k in DETAILS))
    if bands := spectrum(next(iter(shown.values()))):
        lines.append(f"  spectrum inside, ratio to the truth: {bands}")
    worst = left_most(truth)
    return [*lines, f"  most is left of: {worst}"] if worst else lines


def _movers(state: dict[str, Any]) -> list[str]:
    count, what = movers(state)
    return [f"  {count} {what}"] if count else []


def _cost(state: dict[str, Any]) -> list[str]:
    stages = [
        (name, stage)
        for name, stage in state.get("stages", {}).items()
        if isinstance(stage, dict) and isinstance(stage.get("seconds"), int | float)
    ]
    if not stages:
        return []
    lines = [f"  {'stage':<22}{'time':>14}{'peak memory':>14}"]
    for name, stage in stages:
        peak = stage.get("peak_memory_mb")
        lines.append(f"    {name:<20}{seconds(stage['seconds']):>14}{memory(peak) if peak else '-':>14}")
    peaks = [s["peak_memory_mb"] for _, s in stages if s.get("peak_memory_mb")]
    whole = seconds(sum(s["seconds"] for _, s in stages))
    lines.append(f"    {'together':<20}{whole:>14}{memory(max(peaks)) if peaks else '-':>14}")
    return lines
