"""What the page tells of the run: stages, settings, what was assumed."""

from __future__ import annotations

from typing import Any

from unveil_core.report.collect import Shown
from unveil_core.report.command import name_of_path
from unveil_core.report.wording import memory, seconds
from unveil_core.workspace.assumptions import recorded_assumptions

__all__ = ["assumption_rows", "setting_rows", "stages_part", "timed"]


def timed(shown: Shown) -> list[tuple[str, dict[str, Any]]]:
    """The stages that ran, in their order, each with what workspace.json has of it."""
    stages = shown.state.get("stages", {})
    return [(n, s) for n, s in stages.items() if isinstance(s, dict) and isinstance(s.get("seconds"), int | float)]


def stages_part(shown: Shown) -> dict[str, Any] | None:
    """Time and memory of each stage; None where none ran."""
    stages = timed(shown)
    if not stages:
        return None
    longest = max(s["seconds"] for _, s in stages) or 1.0
    rows = []
    for name, stage in stages:
        peak = stage.get("peak_memory_mb")
        rows.append(
            {
                "name": name,
                "share": f"{100 * stage['seconds'] / longest:.1f}",
                "time": seconds(stage["seconds"]),
                "memory": memory(peak) if isinstance(peak, int | float) else "",
            }
        )
    peaks = [s["peak_memory_mb"] for _, s in stages if isinstance(s.get("peak_memory_mb"), int | float)]
    lead = f"{seconds(sum(s['seconds'] for _, s in stages))} in all"
    lead += f", at most {memory(max(peaks))} of memory." if peaks else "."
    return {"lead": lead, "rows": rows}


def assumption_rows(shown: Shown) -> list[tuple[str, str]]:
    """What was assumed of the drive, and whether it holds."""
    found = [a for _, a in recorded_assumptions(shown.state.get("stages", {}))]
    return [(a.name, f"{'yes' if a.holds else 'no'}: {a.found}" + ("" if a.holds else f"; {a.instead}")) for a in found]


def setting_rows(shown: Shown) -> list[tuple[str, str]]:
    """What the run was made with."""
    settings = shown.state.get("settings", {})
    given = {k: v for k, v in settings.items() if v not in (None, []) or k == "remove"}
    rows: list[tuple[str, str]] = [(str(k).replace("_", " "), _value(v)) for k, v in given.items()]
    if "remove" in settings and not settings["remove"] and not settings.get("instances"):
        rows = [(k, "all that can be removed" if k == "remove" else v) for k, v in rows]
    rows += [(f"version of {k}", _value(v)) for k, v in shown.state.get("versions", {}).items()]
    if shown.state.get("drive"):
        rows.insert(0, ("drive", name_of_path(str(shown.state["drive"]), of_drive=True)))
    return rows


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(name_of_path(str(v)) for v in value) or "–"
    return "–" if value is None else name_of_path(str(value))
