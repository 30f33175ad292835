"""The report: one HTML page that needs nothing but itself.

Pictures are inlined, there is no script library and no network. What the workspace does not have (no truth, no mesh, no
objects) is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.progress import Progress, no_progress
from unveil_core.evaluate import FREE_REGIONS, METHODS
from unveil_core.report.chart import psnr_chart
from unveil_core.report.collect import MeshPictures, Shown, gather
from unveil_core.report.pictures import REGION_NAMES
from unveil_core.report.provenance import certainty_cards, mode_legend
from unveil_core.report.video import write_video
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
)
from unveil_core.workspace.assumptions import recorded_assumptions

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
    "line_recall": "Lines found",
    "false_lines": "False lines",
    "residue": "Residue",
}
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
    write_bytes_atomic(Path(out_dir) / "index.html", build_page(shown).encode())
    if sum(f.after is not None for f in shown.frames) > 1:
        write_video(Path(workspace_root), Path(out_dir) / "before_after.mp4")


def build_page(shown: Shown) -> str:
    """The page as text."""
    parts = [
        _header(shown),
        _viewer(shown),
        _numbers(shown),
        _truth(shown),
        _free_views(shown),
        _meshes(shown.meshes),
        _objects(shown),
        _assumptions(shown),
        _stages(shown),
        _settings(shown),
    ]
    style, script = (files("unveil_core.report").joinpath(name).read_text() for name in ("page.css", "page.js"))
    body = "\n".join(p for p in parts if p)
    return (
        "<!doctype html>\n"
        '<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<title>{escape(shown.name)} · Unveil</title>\n<style>\n{style}</style>\n'
        f"</head>\n<body>\n<main>\n{body}\n<footer>Made by Unveil. This page needs no network.</footer>\n</main>\n"
        f"<script>\n{script}</script>\n</body>\n</html>\n"
    )


def _header(shown: Shown) -> str:
    removed = [str(e.get("class", "object")) for e in shown.instances if e.get("removed")]
    kinds = {kind: removed.count(kind) for kind in dict.fromkeys(removed)}
    gone = ", ".join(f"{count} {_plural(kind, count)}" for kind, count in kinds.items())
    facts = [f"{shown.frame_count} frames", f"{shown.size[0]} × {shown.size[1]}"]
    if gone:
        facts.append(f"removed: {gone}")
    return (
        f'<header><div><p class="brand">Unveil</p><h1>{escape(shown.name)}</h1>'
        f"<p>{escape(' · '.join(facts))}</p></div></header>"
    )


def _plural(kind: str, count: int) -> str:
    if count == 1:
        return kind
    return {"person": "people", "bus": "buses"}.get(kind, f"{kind}s")


# --------------------------------------------------------------------------------------------------------------- viewer


def _viewer(shown: Shown) -> str:
    frames = shown.frames
    if not frames:
        return ""
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
    choices = "".join(
        f'<button type="button" data-mode="{key}" aria-pressed="{str(key == modes[0]).lower()}">{MODES[key]}</button>'
        for key in modes
    )
    group = f'<div class="group" role="group" aria-label="Picture on the right">{choices}</div>' if choices else ""
    with_regions = any(f.regions for f in frames)
    regions = '<button type="button" class="regions" aria-pressed="false">Regions</button>' if with_regions else ""
    tags = (
        f'<span class="tag before">Photograph</span><span class="tag after">{MODES[modes[0]]}</span>' if modes else ""
    )
    pictures = _slider_images(frames[first].before, getattr(frames[first], modes[0]) if modes else None)
    overlay = '<img class="overlay" alt="" hidden>'
    legend = f'<ul class="legend of-regions" hidden>{_region_legend()}</ul>' if with_regions else ""
    legend += "".join(mode_legend(mode) for mode in modes)
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    return (
        f'<div id="viewer" class="card viewer" data-first="{first}">'
        f'<div class="slider{"" if modes else " single"}">{pictures}{overlay}{tags}<span class="bar"></span>'
        f"{_split_input('Split between photograph and result') if modes else ''}</div>"
        '<div class="controls"><button type="button" class="play" aria-pressed="false">Play</button>'
        '<div class="grow"><input class="scrub" type="range" min="0" value="0" aria-label="Frame">'
        f'<span class="count"></span></div>{group}{regions}</div>'
        f'{legend}<div class="film"></div></div>'
        f'<script type="application/json" id="frames">{text}</script>'
    )


def _slider_images(before: str, after: str | None) -> str:
    return (
        f'<img class="right" src="{after or before}" alt="The empty street">'
        f'<img class="left" src="{before}" alt="The photograph">'
    )


def _split_input(label: str) -> str:
    return f'<input type="range" min="0" max="100" value="50" step="0.5" aria-label="{label}">'


def _most_telling(shown: Shown) -> int:
    """The shown frame from which most was removed, to open with."""
    removed = {
        (str(e.get("camera")), str(e.get("frame"))): int(e.get("removed_pixels", 0))
        for e in (shown.metrics or {}).get("per_frame", [])
    }
    areas = [removed.get((f.camera_name, f.name), 0) for f in shown.frames]
    return max(range(len(areas)), key=areas.__getitem__)


def _region_legend() -> str:
    return "".join(
        f'<li><i style="background:var(--{REGION_STYLE[k]})"></i>{escape(name)}</li>'
        for k, name in REGION_NAMES.items()
    )


# -------------------------------------------------------------------------------------------------------------- numbers


def _numbers(shown: Shown) -> str:
    metrics = shown.metrics or {}
    cards: list[tuple[str, str]] = []
    methods = _methods(metrics, "removed")
    if "ours" in methods:
        rivals = [m for m in ("telea", "shift_map") if (methods.get(m) or {}).get("psnr") is not None]
        best = max(rivals, key=lambda m: methods[m]["psnr"], default=None)
        beside = f", {METHODS[best]} {decibels(methods[best]['psnr'])}" if best else ""
        cards.append((decibels(methods["ours"].get("psnr")), f"PSNR where something was removed{beside}"))
        cards.append((similarity(methods["ours"].get("ssim")), "SSIM there, against the true empty street"))
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
    stages = _timed(shown)
    if stages:
        cards.append((seconds(sum(s["seconds"] for _, s in stages)), "computing time of all stages"))
    if not cards:
        return ""
    inside = "".join(f'<div class="card number"><b>{escape(b)}</b><span>{escape(s)}</span></div>' for b, s in cards)
    return f'<div class="numbers">{inside}</div>'


def _methods(metrics: dict[str, Any], region: str) -> dict[str, Any]:
    found: dict[str, Any] = metrics.get("truth", {}).get("regions", {}).get(region, {}).get("methods", {})
    return found


def _truth(shown: Shown) -> str:
    metrics = shown.metrics or {}
    regions = [r for r in REGION_TITLES if _methods(metrics, r)]
    if not regions:
        return ""
    heads = "".join(f"<th>{REGION_TITLES[r]}</th>" for r in regions)
    rows = []
    for method, name in METHODS.items():
        if not any(method in _methods(metrics, r) for r in regions):
            continue
        cells = [_score_cell(_methods(metrics, region).get(method)) for region in regions]
        style = ' class="ours"' if method == "ours" else ""
        rows.append(f"<tr{style}><th>{escape(name)}</th>{''.join(cells)}</tr>")
    truth = metrics["truth"]
    notes = []
    if truth.get("unobserved_mask_iou") is not None:
        notes.append(f"What had to be invented was found with an overlap of {percent(truth['unobserved_mask_iou'])}.")
    filled = (_methods(metrics, "removed").get("telea") or {}).get("frames", truth.get("frames"))
    if filled != truth.get("frames"):
        notes.append(f"Telea and shift-map were measured on {filled} of {truth.get('frames')} frames.")
    taken = truth.get("baseline_seconds_per_frame", {})
    if taken:
        notes.append("Time per frame: " + ", ".join(f"{METHODS[m]} {seconds(s)}" for m, s in taken.items()) + ".")
    note = f'<p class="lead" style="margin:14px 0 0">{escape(" ".join(notes))}</p>' if notes else ""
    return _section(
        "Against the true empty street",
        "PSNR of all pixels of a region over all frames / SSIM. Telea and shift-map fill each frame by itself; "
        "they are given the exact mask.",
        f'<div class="card padded"><div class="scroll"><table><thead><tr><th></th>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>{psnr_chart(metrics.get('per_frame', []))}{note}</div>"
        f"{_details(shown)}",
    )


def _details(shown: Shown) -> str:
    """What PSNR forgives in the removed region, a row for each method."""
    truth = (shown.metrics or {}).get("truth", {})
    figures = detail_rows(truth)
    if not figures:
        return ""
    heads = "".join(f"<th>{title}</th>" for title in DETAIL_TITLES.values())
    rows = []
    for name, values in figures.items():
        cells = "".join(f"<td>{detail(k, values.get(k))}</td>" for k in DETAIL_TITLES)
        style = ' class="ours"' if name == METHODS["ours"] else ""
        rows.append(f"<tr{style}><th>{escape(name)}</th>{cells}</tr>")
    words = "Lines are edges of paint and kerbs on the ground; residue still shows the crowded frame's colours."
    if any(frame.lines for frame in shown.frames):
        words += " The view “Lines” shows them: found in green, missed in red, false in blue."
    worst = left_most(truth)
    if worst:
        words += f" Most is left of: {worst}."
    return (
        f'<div class="card padded" style="margin-top:14px"><div class="scroll"><table><thead><tr>'
        f"<th>Where something was removed</th>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
        f'<p class="lead" style="margin:14px 0 0">{escape(words)}</p></div>'
    )


def _free_views(shown: Shown) -> str:
    """The 3D scene from the recorded places and from others, a row each."""
    metrics = shown.metrics or {}
    free = metrics.get("free_views", {})
    columns = [r for r in FREE_REGIONS if r in free.get("regions", {})]
    if not columns:
        return ""
    recorded = {r: _methods(metrics, FREE_REGIONS[r]).get("render") for r in columns}
    places = {"Recorded places": recorded, "All free viewpoints": free["regions"]}
    places |= {track.capitalize(): scores for track, scores in free.get("tracks", {}).items()}
    titles = {**REGION_TITLES, "whole": "Whole picture"}
    heads = "".join(f"<th>{titles[FREE_REGIONS[r]]}</th>" for r in columns)
    rows = "".join(
        f"<tr><th>{escape(place)}</th>{''.join(_score_cell(scores.get(r)) for r in columns)}</tr>"
        for place, scores in places.items()
        if any(scores.values())
    )
    return _section(
        "From free viewpoints",
        f"The rendered empty scene from {free['views']} places where the drive never was, against true pictures from there.",
        f'<div class="card padded"><div class="scroll"><table><thead><tr><th></th>{heads}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div></div>",
    )


def _score_cell(score: dict[str, Any] | None) -> str:
    if not score:
        return "<td>–</td>"
    return f"<td>{decibels(score.get('psnr'))} <small>/ {similarity(score.get('ssim'))}</small></td>"


# --------------------------------------------------------------------------------------------------------- other pieces


def _section(title: str, lead: str, content: str) -> str:
    words = f'<p class="lead">{escape(lead)}</p>' if lead else ""
    return f"<section><h2>{escape(title)}</h2>{words}{content}</section>"


def _meshes(meshes: Sequence[MeshPictures]) -> str:
    figures = []
    for view in meshes:
        both = view.before is not None and view.after is not None
        only = view.after or view.before
        if only is None:
            continue
        tags = '<span class="tag before">Before</span><span class="tag after">After</span>' if both else ""
        inside = _slider_images(view.before or only, only) + tags + '<span class="bar"></span>'
        inside += _split_input(f"Split of the mesh before and after, {escape(view.title.lower())}") if both else ""
        figures.append(
            f'<figure class="card"><div class="slider{"" if both else " single"}">{inside}</div>'
            f"<figcaption>{escape(view.title)}</figcaption></figure>"
        )
    if not figures:
        return ""
    lead = "Fused from the rendered depth of every frame, vertex colours, drawn without textures."
    return _section("The street as a mesh", lead, f'<div class="pair">{"".join(figures)}</div>')


def _objects(shown: Shown) -> str:
    if not shown.instances:
        return ""
    items = []
    for entry in shown.instances:
        picture = entry.get("picture")
        image = f'<img src="{picture}" alt="" loading="lazy">' if picture else '<div class="blank"></div>'
        frames = [str(entry[k]) for k in ("first_frame", "last_frame") if entry.get(k) is not None]
        where = (
            f"frames {frames[0]} to {frames[1]}" if len(set(frames)) == 2 else "".join(f"frame {f}" for f in frames[:1])
        )
        size = _box_size(entry.get("box"))
        status = "removed" if entry.get("removed") else "kept"
        lines = [status, size, where]
        text = "<br>".join(escape(line) for line in lines if line)
        title = f"{entry.get('class', 'object')} {entry.get('id', '')}"
        style = "card" if entry.get("removed") else "card kept"
        items.append(f'<li class="{style}">{image}<p><b>{escape(title)}</b><br>{text}</p></li>')
    lead = "The number is the one that --instances takes."
    return _section("Objects", lead, f'<ul class="objects">{"".join(items)}</ul>')


def _box_size(box: Any) -> str:
    size = box.get("size") if isinstance(box, dict) else None
    if not isinstance(size, Sequence) or len(size) != 3:
        return ""
    return " × ".join(f"{float(v):.1f}" for v in size) + " m"


def _timed(shown: Shown) -> list[tuple[str, dict[str, Any]]]:
    stages = shown.state.get("stages", {})
    return [(n, s) for n, s in stages.items() if isinstance(s, dict) and isinstance(s.get("seconds"), int | float)]


def _stages(shown: Shown) -> str:
    stages = _timed(shown)
    if not stages:
        return ""
    longest = max(s["seconds"] for _, s in stages) or 1.0
    rows = []
    for name, stage in stages:
        share = 100 * stage["seconds"] / longest
        peak = stage.get("peak_memory_mb")
        rows.append(
            f'<span>{escape(name)}</span><span class="bar"><i style="width:{share:.1f}%"></i></span>'
            f'<span class="value">{seconds(stage["seconds"])}</span>'
            f'<span class="value memory">{memory(peak) if peak is not None else ""}</span>'
        )
    peaks = [s["peak_memory_mb"] for _, s in stages if isinstance(s.get("peak_memory_mb"), int | float)]
    lead = f"{seconds(sum(s['seconds'] for _, s in stages))} in all"
    lead += f", at most {memory(max(peaks))} of memory." if peaks else "."
    return _section("Time and memory", lead, f'<div class="card padded bars">{"".join(rows)}</div>')


def _assumptions(shown: Shown) -> str:
    found = [a for _, a in recorded_assumptions(shown.state.get("stages", {}))]
    if not found:
        return ""
    rows = [(a.name, f"{'yes' if a.holds else 'no'}: {a.found}" + ("" if a.holds else f"; {a.instead}")) for a in found]
    lead = "What the method assumes of a street, tested on this one; where it does not hold, something else is done."
    return _section("Assumptions", lead, f'<div class="card padded"><dl>{_definitions(rows)}</dl></div>')


def _settings(shown: Shown) -> str:
    settings = shown.state.get("settings", {})
    rows: list[tuple[str, str]] = [(str(k).replace("_", " "), _value(v)) for k, v in settings.items()]
    if "remove" in settings and not settings["remove"] and not settings.get("instances"):
        rows = [(k, "all that can be removed" if k == "remove" else v) for k, v in rows]
    rows += [(f"version of {k}", _value(v)) for k, v in shown.state.get("versions", {}).items()]
    if shown.state.get("drive"):
        rows.insert(0, ("drive", str(shown.state["drive"])))
    if not rows:
        return ""
    return _section("Settings", "", f'<div class="card padded"><dl>{_definitions(rows)}</dl></div>')


def _definitions(rows: Iterable[tuple[str, str]]) -> str:
    return "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(str(v) for v in value) or "–"
    return "–" if value is None else str(value)
