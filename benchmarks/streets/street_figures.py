"""Rows of streets by seed: which may be looked at, which count as a first look, their means and their plot."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.evaluate.detail.scores import DETAIL_FIGURES

__all__ = ["BASELINES", "FIGURES", "GROUPS", "UNSEEN_FROM", "Row", "group_of", "may_be_shown", "plot", "recorded", "summarized"]

BASELINES = ("telea", "shift_map")
FIGURES = ("psnr", "ssim", *DETAIL_FIGURES)
"""Of a region. Rows of before the spectrum was measured have none of it, and no say in its mean."""
UNSEEN_FROM = 28
"""Seeds below are for work. Of those from here on, but for ``SEEN``, nobody looks at pictures, and nothing is chosen by them."""
SEEN = frozenset({30, 33, 34, 35, 36, 38, 42, 44, 45, *range(47, 68), 70, *range(72, 77), *range(78, 84), 85, 86, 87})
"""Seeds from there on that were looked at after their first run, the worst ones among them. A mean without them would flatter."""
GROUPS = {
    "0-9": range(10),
    "10-19": range(10, 20),
    "20-27": range(20, 28),
    "28-33": range(28, 34),
    "34-39": range(34, 40),
    "40-45": range(40, 46),
    "46-51": range(46, 52),
    "52-55": range(52, 56),
    "56-59": range(56, 60),
    "60-63": range(60, 64),
    "64-67": range(64, 68),
    "68-71": range(68, 72),
    "72-75": range(72, 76),
    "76-79": range(76, 80),
    "80-83": range(80, 84),
    "84-87": range(84, 88),
    "88-91": range(88, 92),
    "92 on": range(92, 10**6),
}
"""Seeds that had their first look in one state of the program; those of the first group were worked on from the beginning."""
POOLED = "28 on"
"""Name of the group of all seeds that were held out when they were first run, looked at later or not."""
REGIONS = ("removed", "unseen", "seen_elsewhere", "cast_shadow", "cast_shadow_input", "input", "best_opencv")
COLORS = {"0-9": "#1f3b73", "10-19": "#2b6cb0", "20-27": "#63b3ed", "28 on, looked at": "#dd6b20", "28 on": "#38a169"}
"""Of the bars of the plot: blue for work, green where nobody has looked."""
RIVAL = "#202020"

Row = dict[str, Any]


def may_be_shown(seed: int) -> bool:
    """Whether pictures of a seed may be looked at."""
    return seed < UNSEEN_FROM or seed in SEEN


def group_of(seed: int) -> str:
    """Name of a seed's group."""
    return next(name for name, seeds in GROUPS.items() if seed in seeds)


def recorded(document: dict[str, Any], quality: str, seed: int, row: Row) -> None:
    """Put a row into the document: as the latest of its seed, and as its first look if it is one.

    A first look is the first row of a seed that nobody has looked at. It is kept whatever later runs of the seed give, but for
    another generator's, which draws another street under the same seed.
    """
    looks = document.setdefault("first_looks", {}).setdefault(quality, {})
    before = looks.get(str(seed))
    if not may_be_shown(seed) and (before is None or before["generator"] != row["generator"]):
        looks[str(seed)] = row
    document.setdefault("runs", {}).setdefault(quality, {})[str(seed)] = row
    for kind in ("first_looks", "runs"):
        document[kind][quality] = dict(sorted(document[kind][quality].items(), key=lambda item: int(item[0])))


def summarized(document: dict[str, Any], quality: str, generator: str) -> dict[str, Any]:
    """The document with the means of a quality, of first looks and of the latest rows, each by group.

    Args:
        generator: version of the streets; rows of another one are of other streets, and do not count.
    """
    found = {}
    for name, kind in (("first_look", "first_looks"), ("latest", "runs")):
        rows = {int(s): r for s, r in document.get(kind, {}).get(quality, {}).items() if r["generator"] == generator}
        groups = {POOLED: [r for s, r in rows.items() if s >= UNSEEN_FROM]}
        groups |= {group: [r for s, r in rows.items() if s in seeds] for group, seeds in GROUPS.items()}
        found[name] = {group: means(of) for group, of in groups.items() if of}
    document.setdefault("means", {})[quality] = found
    return document


def means(rows: list[Row]) -> dict[str, Any]:
    """Means over streets: of those that were measured."""
    found: dict[str, Any] = {"streets": len(rows), "failed": sum("error" in r for r in rows)}
    good = [r for r in rows if "error" not in r]
    for region in REGIONS:
        here = [r[region] for r in good if r.get(region)]
        found[region] = {k: _mean(h.get(k) for h in here) for k in FIGURES}
    certain = [r["certain"] for r in good if r.get("certain")]
    found["certain"] = {k: _mean(c[k] for c in certain) for k in ("certain", "certain_right")}
    found["lowest"] = min((r["removed"]["psnr"] for r in good if r.get("removed")), default=None)
    found["flicker"] = {m: _mean(r["flicker"].get(m) for r in good) for m in ("ours", "truth", *BASELINES)}
    found["changed_share_outside"] = _mean(r["outside"]["changed_share"] for r in good)
    for name in ("seconds", "peak_memory_mb"):
        found[name] = _mean(r[name] for r in good)
    ahead = [r["removed"]["psnr"] - r["best_opencv"]["psnr"] for r in good if r.get("best_opencv")]
    found["ahead_of_best_opencv"] = sum(a > 0 for a in ahead)
    found["gain_over_best_opencv_db"] = _mean(ahead)
    return found


def _mean(values: Iterable[float | None]) -> float | None:
    """Of those that are there; None where none is."""
    there = [v for v in values if v is not None]
    return round(float(np.mean(there)), 4) if there else None


def plot(rows: dict[str, Row], path: Path, title: str) -> None:
    """PSNR in the removed region, ours and the best OpenCV row's: a histogram, and a bar for each seed, the worst one first.

    Figures of seeds that nobody looks at are in it, too: they tell nothing of what is wrong with them.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    good = {int(s): r for s, r in rows.items() if r.get("removed") and r.get("best_opencv")}
    if not good:
        return
    seeds = sorted(good, key=lambda seed: good[seed]["removed"]["psnr"])
    ours, rival = ([good[s][name]["psnr"] for s in seeds] for name in ("removed", "best_opencv"))
    # A bar takes the room that a number of two digits needs below it.
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(4.5 + max(4.0, 0.19 * len(seeds)), 3.8), width_ratios=(3.5, max(4.0, 0.19 * len(seeds)))
    )
    bins = np.arange(np.floor(min(ours + rival)), np.ceil(max(ours + rival)) + 1.0, 1.0)
    left.hist([ours, rival], bins=bins, label=["Unveil", "best OpenCV row"], color=[COLORS["10-19"], RIVAL])
    left.set_xlabel("PSNR inside the removed region, dB")
    left.set_ylabel("streets")
    left.legend(fontsize=7)
    at = np.arange(len(seeds))
    kinds = [_kind(seed) for seed in seeds]
    right.bar(at, ours, 0.8, color=[COLORS[kind] for kind in kinds])
    dots = right.scatter(at, rival, s=9, color=RIVAL, zorder=3, label="best OpenCV row")
    right.set_xticks(at, [str(seed) for seed in seeds], fontsize=7)
    right.set_xlim(-0.7, len(seeds) - 0.3)
    right.set_ylim(min(ours + rival) - 2, None)
    right.set_xlabel("seed")
    right.set_ylabel("dB")
    there = [Patch(color=color, label=kind) for kind, color in COLORS.items() if kind in kinds]
    right.legend(handles=[*there, dots], fontsize=7, loc="upper left")
    figure.suptitle(title)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _kind(seed: int) -> str:
    """Name of a seed's colour."""
    if seed < UNSEEN_FROM:
        return group_of(seed)
    return "28 on, looked at" if may_be_shown(seed) else "28 on"
