"""The report: one HTML page that needs nothing but itself.

Pictures, the scene and its flight are inlined, there is no script library and no network. What the workspace does not have (no
truth, no mesh, no objects) is left out. Words come from files of strangers: the template (page.html.j2) escapes them all, and the
page forbids any script but its own.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.progress import Progress, no_progress
from unveil_core.evaluate import FREE_REGIONS, METHODS
from unveil_core.report.chart import psnr_chart
from unveil_core.report.collect import MeshPictures, Shown, gather, understood
from unveil_core.report.command import repeating_command
from unveil_core.report.of_run import assumption_rows, setting_rows, stages_part, timed
from unveil_core.report.pictures import REGION_NAMES
from unveil_core.report.provenance import certainty_cards, mode_legend, origin_shares
from unveil_core.report.scene.parts import inert_json, map_part, scene_part
from unveil_core.report.video import write_video
from unveil_core.report.wording import (
    WAVELENGTHS,
    decibels,
    detail,
    detail_rows,
    left_most,
    movers,
    percent,
    seconds,
    similarity,
)

__all__ = ["build_page", "write_report"]

MODES = {"after": "Empty street", "rendered": "Rendered", "inpainted": "Pseudo label", "lines": "Lines"}
MODES |= {"provenance": "Provenance", "certainty": "Certainty"}
REGION_TITLES = {
    "removed": "Whole removed region",
    "seen_elsewhere": "Seen from other frames",
    "unseen": "Never seen",
    "cast_shadow": "Cast shadows",
}
DETAIL_TITLES = {
    "gradient": "Gradient, ratio to the truth",
    **{name: f"Spectrum, {band}" for name, band in WAVELENGTHS.items()},
    "line_recall": "Lines found",
    "false_lines": "False lines",
    "residue": "Residue",
}
Part = dict[str, Any]
"""What a part of the template shows."""
MOST_OBJECTS = 500
"""On the page; of more, the number is told."""
REGION_STYLE = {1: "observed", 2: "elsewhere", 3: "unseen"}


def write_report(
    workspace_root: Path, out_dir: Path, metrics: dict[str, Any] | None = None, progress: Progress = no_progress
) -> None:
    """Write ``index.html`` and, where frames were delivered, the movie ``before_after.mp4``.

    Args:
        workspace_root: the workspace; only ``drive/`` has to be there.
        out_dir: folder of the page, made if need be.
        metrics: what ``run_evaluation`` returned; ``metrics.json`` of the workspace by default.
        progress: called once per frame.
    """
    shown = gather(Path(workspace_root), metrics, progress)
    with understood(Path(workspace_root)):
        page = build_page(shown).encode("utf-8", "replace")
    write_bytes_atomic(Path(out_dir) / "index.html", page)
    if sum(f.after is not None for f in shown.frames) > 1:
        write_video(Path(workspace_root), Path(out_dir) / "before_after.mp4")


def build_page(shown: Shown) -> str:
    """The page as text."""
    style, sliders, turning, template = (
        files("unveil_core.report").joinpath(name).read_text(encoding="utf-8")
        for name in ("page.css", "page.js", "scene.js", "page.html.j2")
    )
    script = sliders + turning
    objects = shown.instances[:MOST_OBJECTS]
    made = Environment(autoescape=True, undefined=StrictUndefined).from_string(template)
    return made.render(
        policy=_policy(script),
        style=Markup(style),
        script=Markup(script),
        name=shown.name,
        facts=_facts(shown),
        viewer=_viewer(shown),
        numbers=_numbers(shown),
        scene=scene_part(shown.scene),
        map=map_part(shown.scene, objects),
        origins=origin_shares(shown.metrics or {}),
        truth=_truth(shown),
        free_views=_free_views(shown),
        meshes=_meshes(shown.meshes),
        objects=[_object(entry) for entry in objects],
        more_objects=len(shown.instances) - len(objects),
        assumptions=assumption_rows(shown),
        stages=stages_part(shown),
        settings=setting_rows(shown),
        command=repeating_command(shown.state, shown.workspace),
    )


def _policy(script: str) -> str:
    """What a browser lets the page do: run this script and no other, show pictures and movies that are in it, and reach nothing."""
    digest = base64.b64encode(hashlib.sha256(f"\n{script}".encode()).digest()).decode()
    allowed = f"img-src data:; media-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    return f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"


def _facts(shown: Shown) -> str:
    removed = [str(e.get("class", "object")) for e in shown.instances if e.get("removed")]
    kinds = {kind: removed.count(kind) for kind in dict.fromkeys(removed)}
    gone = ", ".join(f"{count} {_plural(kind, count)}" for kind, count in kinds.items())
    facts = [f"{shown.frame_count} frames", f"{shown.size[0]} × {shown.size[1]}"]
    if gone:
        facts.append(f"removed: {gone}")
    return " · ".join(facts)


def _plural(kind: str, count: int) -> str:
    if count == 1:
        return kind
    return {"person": "people", "bus": "buses"}.get(kind, f"{kind}s")


# --------------------------------------------------------------------------------------------------------------- viewer


def _viewer(shown: Shown) -> Part | None:
    frames = shown.frames
    if not frames:
        return None
    modes = [key for key in MODES if any(getattr(f, key) for f in frames)]
    several = len({f.camera_name for f in frames}) > 1
    data = [
        {
            "name": f.name,
            "label": f"{f.camera_name} / {f.name}" if several else f.name,
            "before": f.before,
            **{key: getattr(f, key) for key in (*modes, "regions") if getattr(f, key)},
        }
        for f in frames
    ]
    first = _most_telling(shown)
    regions = [(f"var(--{REGION_STYLE[k]})", name) for k, name in REGION_NAMES.items()]
    return {
        "first": first,
        "before": frames[first].before,
        "after": getattr(frames[first], modes[0]) if modes else None,
        "modes": [(mode, MODES[mode]) for mode in modes],
        "tags": [("before", "Photograph"), ("after", MODES[modes[0]])] if modes else [],
        "regions": regions if any(f.regions for f in frames) else [],
        "legends": [(mode, entries) for mode in modes if (entries := mode_legend(mode))],
        "frames": inert_json(data),
    }


def _most_telling(shown: Shown) -> int:
    """The shown frame from which most was removed, to open with."""
    removed = {
        (str(e.get("camera")), str(e.get("frame"))): int(e.get("removed_pixels", 0))
        for e in (shown.metrics or {}).get("per_frame", [])
    }
    areas = [removed.get((f.camera_name, f.name), 0) for f in shown.frames]
    return max(range(len(areas)), key=areas.__getitem__)


# -------------------------------------------------------------------------------------------------------------- numbers


def _numbers(shown: Shown) -> list[tuple[str, str]]:
    metrics = shown.metrics or {}
    cards: list[tuple[str, str]] = []
    methods = _methods(metrics, "removed")
    if "ours" in methods:
        rivals = [m for m in ("telea", "shift_map") if (methods.get(m) or {}).get("psnr") is not None]
        best = max(rivals, key=lambda m: methods[m]["psnr"], default=None)
        beside = f", {METHODS[best]} {decibels(methods[best]['psnr'])}" if best else ""
        cards.append((decibels(methods["ours"].get("psnr")), f"PSNR where something was removed{beside}"))
        cards.append((similarity(methods["ours"].get("ssim")), "SSIM there, against the true empty street"))
        cards += _detail_cards(methods["ours"])
    coverage = metrics.get("coverage", {})
    if coverage.get("removed"):
        cards.append((percent(coverage["removed"]), "of all pixels showed something that is gone"))
    moved, what = movers(shown.state)
    if moved:
        cards.append((str(moved), what))
    if coverage.get("unobserved_of_removed") is not None:
        cards.append((percent(coverage["unobserved_of_removed"]), "of these were never seen and had to be invented"))
    cards += certainty_cards(metrics)
    untouched = metrics.get("untouched", {})
    if "max" in untouched:
        text = "not one" if untouched["max"] == 0 else f"up to {untouched['max']} levels"
        note = "pixel outside the masks changed" if untouched["max"] == 0 else "of change outside the masks"
        cards.append((text.capitalize(), note))
    stages = timed(shown)
    if stages:
        cards.append((seconds(sum(s["seconds"] for _, s in stages)), "computing time of all stages"))
    return cards


def _detail_cards(ours: dict[str, Any]) -> list[tuple[str, str]]:
    """What PSNR forgives, as far as it was measured: metrics of an earlier version have none, and without ground there are no
    lines."""
    cards = []
    if ours.get("gradient") is not None:
        cards.append((detail("gradient", ours["gradient"]), "gradient energy there, as a ratio to the true street's"))
    lines = {name: ours.get(name) for name in ("line_recall", "false_lines")}
    if any(value is not None for value in lines.values()):
        found, false = (detail(name, value) for name, value in lines.items())
        cards.append(
            (f"{found} / {false}", "lines on the ground there: share of true ones found / share of ours that are false")
        )
    return cards


def _methods(metrics: dict[str, Any], region: str) -> dict[str, Any]:
    found: dict[str, Any] = metrics.get("truth", {}).get("regions", {}).get(region, {}).get("methods", {})
    return found


def _truth(shown: Shown) -> Part | None:
    metrics = shown.metrics or {}
    regions = [r for r in REGION_TITLES if _methods(metrics, r)]
    if not regions:
        return None
    rows = [
        _row(name, [_score(_methods(metrics, region).get(method)) for region in regions])
        for method, name in METHODS.items()
        if any(method in _methods(metrics, r) for r in regions)
    ]
    truth = metrics["truth"]
    notes = []
    if truth.get("unobserved_mask_iou") is not None:
        notes.append(f"What had to be invented was found with an overlap of {percent(truth['unobserved_mask_iou'])}.")
    filled = (_methods(metrics, "removed").get("telea") or {}).get("frames", truth.get("frames"))
    if not truth.get("baseline_seconds_per_frame"):
        notes.append("Single-image inpainters were not measured (--baselines asks for them).")
    elif filled != truth.get("frames"):
        notes.append(f"Telea and shift-map were measured on {filled} of {truth.get('frames')} frames.")
    taken = truth.get("baseline_seconds_per_frame", {})
    if taken:
        notes.append("Time per frame: " + ", ".join(f"{METHODS[m]} {seconds(s)}" for m, s in taken.items()) + ".")
    return {
        "table": {"heads": [REGION_TITLES[r] for r in regions], "rows": rows},
        "chart": psnr_chart(metrics.get("per_frame", [])),
        "note": " ".join(notes),
        "details": _details(shown),
    }


def _details(shown: Shown) -> Part | None:
    """What PSNR forgives in the removed region, a row for each method."""
    truth = (shown.metrics or {}).get("truth", {})
    figures = detail_rows(truth)
    if not figures:
        return None
    # Metrics of an earlier version have no spectrum.
    titles = {key: title for key, title in DETAIL_TITLES.items() if any(key in values for values in figures.values())}
    rows = [_row(name, [{"text": detail(key, values.get(key))} for key in titles]) for name, values in figures.items()]
    words = (
        "Spectrum is the strength of detail by its wavelength, as a ratio to the truth's. "
        if WAVELENGTHS.keys() & titles.keys()
        else ""
    )
    words += "Lines are edges of paint and kerbs on the ground; residue still shows the crowded frame's colours."
    if any(frame.lines for frame in shown.frames):
        words += " The view “Lines” shows them: found in green, missed in red, false in blue."
    worst = left_most(truth)
    if worst:
        words += f" Most is left of: {worst}."
    return {"table": {"heads": list(titles.values()), "rows": rows}, "words": words}


def _free_views(shown: Shown) -> Part | None:
    """The 3D scene from the recorded places and from others, a row each."""
    metrics = shown.metrics or {}
    free = metrics.get("free_views", {})
    columns = [r for r in FREE_REGIONS if r in free.get("regions", {})]
    if not columns:
        return None
    recorded = {r: _methods(metrics, FREE_REGIONS[r]).get("render") for r in columns}
    places = {"Recorded places": recorded, "All free viewpoints": free["regions"]}
    places |= {track.capitalize(): scores for track, scores in free.get("tracks", {}).items()}
    titles = {**REGION_TITLES, "whole": "Whole picture"}
    rows = [
        _row(place, [_score(scores.get(r)) for r in columns])
        for place, scores in places.items()
        if any(scores.values())
    ]
    lead = f"The rendered empty scene from {free['views']} places where the drive never was, against true pictures from there."
    return {"lead": lead, "table": {"heads": [titles[FREE_REGIONS[r]] for r in columns], "rows": rows}}


def _row(name: str, cells: Sequence[Part]) -> Part:
    return {"name": name, "ours": name == METHODS["ours"], "cells": cells}


def _score(score: dict[str, Any] | None) -> Part:
    if not score:
        return {"text": "–"}
    return {"text": decibels(score.get("psnr")), "small": f"/ {similarity(score.get('ssim'))}"}


# --------------------------------------------------------------------------------------------------------- other pieces


def _meshes(meshes: Sequence[MeshPictures]) -> list[Part]:
    found: list[Part] = []
    for view in meshes:
        both = view.before is not None and view.after is not None
        only = view.after or view.before
        if only is not None:
            split = f"Split of the mesh before and after, {view.title.lower()}" if both else ""
            tags = [("before", "Before"), ("after", "After")] if both else []
            found.append(
                {"title": view.title, "before": view.before or only, "after": only, "split": split, "tags": tags}
            )
    return found


def _object(entry: dict[str, Any]) -> Part:
    frames = [str(entry[k]) for k in ("first_frame", "last_frame") if entry.get(k) is not None]
    where = f"frames {frames[0]} to {frames[1]}" if len(set(frames)) == 2 else "".join(f"frame {f}" for f in frames[:1])
    lines = ["removed" if entry.get("removed") else "kept", _box_size(entry.get("box")), where]
    return {
        "title": f"{entry.get('class', 'object')} {entry.get('id', '')}",
        "removed": bool(entry.get("removed")),
        "picture": entry.get("picture"),
        "lines": [line for line in lines if line],
    }


def _box_size(box: Any) -> str:
    size = box.get("size") if isinstance(box, dict) else None
    if not isinstance(size, Sequence) or len(size) != 3:
        return ""
    return " × ".join(f"{float(v):.1f}" for v in size) + " m"
