"""Drawn streets: first looks, the way ahead, parts switched off, starts without a LiDAR, certainty of pixels."""

from __future__ import annotations

from statistics import mean, median
from typing import Any

from docs.tables.read import both, db, percent, results, table

__all__ = ["ahead", "certainty", "first_looks", "ranges", "special_cases", "without_lidar"]

OLDER = (("0 to 9, for work, latest", range(10)), ("10 to 27, first look", range(10, 28)))
"""Groups that the page shows beside the pooled one."""
KEPT = ("facades", "houses", "path_ahead", "quilting")
"""Special cases that the program still has."""


def _mean(rows: list[dict[str, Any]], region: str, figure: str) -> float:
    return mean(row[region][figure] for row in rows if row[region].get(figure) is not None)


def _cells(rows: list[dict[str, Any]]) -> list[str]:
    recall, wrong = (_mean(rows, "removed", f) for f in ("line_recall", "false_lines"))
    flicker = [mean(row["flicker"][key] for row in rows) for key in ("ours", "truth")]
    return [
        f"{_mean(rows, 'removed', 'psnr'):.1f} dB / {_mean(rows, 'removed', 'ssim'):.2f}",
        f"{_mean(rows, 'removed', 'gradient'):.2f}",
        f"{percent(recall)} / {percent(wrong)}",
        percent(_mean(rows, "removed", "residue"), 1),
        f"{_mean(rows, 'cast_shadow', 'psnr'):.1f} dB",
        f"{min(row['removed']['psnr'] for row in rows):.1f} to {max(row['removed']['psnr'] for row in rows):.1f} dB",
        f"{_mean(rows, 'best_opencv', 'psnr'):.1f} dB",
        f"{flicker[0]:.1f} / {flicker[1]:.1f}",
    ]


def first_looks() -> str:
    """Means over streets in groups, of the first run of each where there is one."""
    document = results("streets")
    looks, latest = (
        {int(seed): row for seed, row in document[k]["standard"].items() if "removed" in row}
        for k in ("first_looks", "runs")
    )
    groups = [(name, [(latest if "latest" in name else looks)[s] for s in seeds]) for name, seeds in OLDER]
    held_out = sorted(seed for seed in looks if seed >= 28)
    groups.append((f"**28 to {held_out[-1]}, first look**", [looks[s] for s in held_out]))
    groups.append((f"28 to {held_out[-1]}, latest run of each", [latest[s] for s in held_out]))
    return table(
        (
            "streets",
            "PSNR / SSIM",
            "gradient",
            "lines found / false",
            "residue",
            "cast shadows",
            "lowest to highest",
            "best of OpenCV",
            "flicker, ours / true",
        ),
        ((name, *_cells(rows)) for name, rows in groups),
    )


def ranges() -> str:
    """What the held-out streets reached at their first look, in one sentence."""
    document = results("streets")
    looks = [row for seed, row in document["first_looks"]["standard"].items() if int(seed) >= 28]
    found = sorted(row["removed"]["psnr"] for row in looks)
    under = sum(value < 20 for value in found)
    behind = sum(row["removed"]["psnr"] < row["best_opencv"]["psnr"] for row in looks)
    return (
        f"Of the {len(found)} held-out streets {under} were below 20 dB at their first look, and {behind} behind the better of"
        f" OpenCV's fillings. The lowest had {found[0]:.1f} dB, the highest {found[-1]:.1f}, the median {median(found):.1f}."
    )


def ahead() -> str:
    """How far aside of the true street its path lies ahead of the last camera."""
    document = results("street_ahead")
    streets = list(document["streets"].values())
    rows = []
    for key, name in (("driven", "prolonged as the car drove"), ("followed", "followed by what the frames show")):
        columns = list(zip(*([abs(v) for v in street[key]] for street in streets), strict=True))
        rows.append((name, *(f"{mean(column):.2f} ({median(column):.2f})" for column in columns)))
    return table((f"mean (median) of {len(streets)} streets", *(f"{m} m ahead" for m in document["ahead_m"])), rows)


def special_cases() -> str:
    """Each part of inpainting that is for one kind of thing, switched off by itself; parts that are gone since are left out."""
    document = results("special_cases")
    found = {case: row for case, row in document["means"]["standard"].items() if case in KEPT}
    rows = []
    for case, row in sorted(found.items(), key=lambda item: item[1]["psnr"]):
        lines = f"{100 * row['line_recall']:+.1f} / {100 * row['false_lines']:+.1f}"
        rows.append((document["cases"][case], f"{row['psnr']:+.2f} dB", lines, f"{row['changed']} of {row['streets']}"))
    return table(("without", "PSNR", "lines found / false", "changed streets"), rows)


def without_lidar() -> str:
    """Both sample streets from 3,000 points: street / road, with and without the search for the ground in photographs."""
    found = results("without_lidar")["rows"]
    rows = []
    for labels in ("labels", "masks"):
        for start in ("points", "photographs"):
            of = [found[f"{scene}_{labels}_{start}"] for scene in ("parked_street", "country_road")]
            lines = (" / ".join(percent(row["removed"][key]) for row in of) for key in ("line_recall", "false_lines"))
            shadows = " / ".join(db(row["cast_shadow"]) for row in of)
            rows.append((labels, start, *(both(row["removed"]) for row in of), *lines, shadows))
    head = ("known", "ground by", "parked street", "country road", "lines found", "false lines", "cast shadows")
    return table(head, rows)


def certainty() -> str:
    """What is called certain, and how much of it is right, on drives that the fit has not seen."""
    found = results("certainty")
    means, drives = found["mean"], found["not_fitted_on"]
    rows = []
    for level in ("224", str(found["certain"]), "240", "248"):
        cells: list[str] = []
        for group in ("real", "drawn"):
            of_level = means[group] if int(level) == found["certain"] else means[group]["levels"][level]
            cells += [percent(of_level[k], 1) for k in ("called_certain", "certain_right", "worst")]
        rows.append((f"{level}, certain" if int(level) == found["certain"] else level, *cells))
    real, drawn = (means[group]["drives"] for group in ("real", "drawn"))
    assert real + drawn == len(drives)
    head = ("level", f"called, {real} real drives", "right", "worst", f"called, {drawn} drawn streets", "right", "worst")
    return table(head, rows)
