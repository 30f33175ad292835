"""The figures of a whole drive: those of its frames, pooled."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from unveil_core.evaluate.baselines import BASELINES
from unveil_core.evaluate.detail.scores import DETAIL_FIGURES, DetailScore, detail_figures
from unveil_core.evaluate.frame_scores import FrameScores, Score
from unveil_core.evaluate.metrics import psnr_of_mse
from unveil_core.evaluate.perceptual import frechet_distance
from unveil_core.evaluate.pictures import REGIONS
from unveil_core.evaluate.provenance import provenance_figures

__all__ = ["METHODS", "summary"]

METHODS: dict[str, str] = {
    "ours": "Unveil",
    "render": "Unveil, rendered",
    "input": "input, untouched",
    "telea": "Telea",
    "shift_map": "shift-map",
}
"""Keys of the measured methods and how people call them."""


def summary(results: list[FrameScores], classes: Mapping[int, str]) -> dict[str, Any]:
    """The figures of a drive from those of its frames, as :func:`unveil_core.evaluate.run_evaluation` returns them, not rounded.

    Args:
        results: of all frames; classes: of the objects, by id.
    """
    pixels = sum(r.pixels for r in results)
    removed = sum(r.removed for r in results)
    unobserved = sum(r.unobserved for r in results)
    values = sum(r.untouched_values for r in results)
    metrics: dict[str, Any] = {
        "frames": len(results),
        "coverage": {
            "removed": removed / max(pixels, 1),
            "unobserved_of_removed": unobserved / removed if removed else None,
            "seen_elsewhere_of_removed": 1 - unobserved / removed if removed else None,
        },
        "untouched": {
            "max": max((r.untouched_max for r in results), default=0),
            "mean": sum(r.untouched_sum for r in results) / max(values, 1),
            "pixels": values // 3,
        },
    }
    with_truth = [r for r in results if r.scores]
    if with_truth:
        metrics["truth"] = _truth_summary(with_truth, classes)
    metrics.update(provenance_figures([r.provenance for r in results if r.provenance is not None]))
    metrics["per_frame"] = [_frame_summary(r) for r in results]
    return metrics


def _truth_summary(results: list[FrameScores], classes: Mapping[int, str]) -> dict[str, Any]:
    grouped: dict[str, dict[str, list[Score]]] = defaultdict(lambda: defaultdict(list))
    for result in results:
        for (region, method), score in result.scores.items():
            grouped[region][method].append(score)
    details: dict[tuple[str, str], list[DetailScore]] = defaultdict(list)
    for result in results:
        for where, detail in result.details.items():
            details[where].append(detail)
    regions: dict[str, Any] = {}
    for region in REGIONS:
        if region not in grouped:
            continue
        by_method = grouped[region]
        regions[region] = {
            "pixels": sum(s.pixels for s in by_method["input"]),
            "frames": len(by_method["input"]),
            "methods": {m: _pooled(by_method[m], details.get((region, m))) for m in METHODS if m in by_method},
        }
    for method, values in regions["whole"]["methods"].items():
        values.update(_perceptual(results, method))
    summary: dict[str, Any] = {"frames": len(results), "regions": regions}
    for name in ("unobserved", "removed"):
        overlaps = [r.overlaps[name] for r in results if name in r.overlaps]
        union = sum(o[1] for o in overlaps)
        if union:
            summary[f"{name}_mask_iou"] = sum(o[0] for o in overlaps) / union
    objects = _objects(results, classes)
    if objects:
        summary["residue_by_object"] = objects
    timed = {name: [r.seconds[name] for r in results if name in r.seconds] for name in BASELINES}
    summary["baseline_seconds_per_frame"] = {n: sum(s) / len(s) for n, s in timed.items() if s}
    return summary


def _objects(results: list[FrameScores], classes: Mapping[int, str]) -> list[dict[str, Any]]:
    """The removed objects and what is left of them, those first that left most pixels."""
    sums: dict[int, list[int]] = defaultdict(lambda: [0, 0])
    for result in results:
        for number, (left, pixels) in result.objects.items():
            sums[number][0] += left
            sums[number][1] += pixels
    worst_first = sorted(sums.items(), key=lambda item: (-item[1][0], item[0]))
    return [
        {"id": i, "class": classes.get(i, "object"), "left": left, "pixels": pixels, "residue": left / pixels}
        for i, (left, pixels) in worst_first
    ]


def _perceptual(results: list[FrameScores], method: str) -> dict[str, float]:
    """LPIPS and FID of a method, as far as there are networks for them."""
    found: dict[str, float] = {}
    distances = [r.lpips[method] for r in results if method in r.lpips]
    if distances:
        found["lpips"] = sum(distances) / len(distances)
    pairs = [r.features[method] for r in results if method in r.features]
    if pairs:
        ours, true = (np.stack(features) for features in zip(*pairs, strict=True))
        found["fid"] = frechet_distance(ours, true) if len(pairs) > 1 else math.nan
    return found


def _pooled(scores: list[Score], details: list[DetailScore] | None) -> dict[str, float | int]:
    pixels = sum(s.pixels for s in scores)
    return {
        "psnr": psnr_of_mse(sum(s.squared for s in scores) / pixels),
        "psnr_frame_mean": _finite_mean(psnr_of_mse(s.squared / s.pixels) for s in scores),
        "ssim": sum(s.similarity for s in scores) / pixels,
        "ssim_frame_mean": _finite_mean(s.similarity / s.pixels for s in scores),
        **({} if details is None else detail_figures(details)),
        "frames": len(scores),
    }


def _frame_summary(result: FrameScores) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "frame": result.name,
        "camera": result.camera_name,
        "removed_pixels": result.removed,
        "unobserved_pixels": result.unobserved,
        "untouched_max": result.untouched_max,
    }
    scored = {m: result.scores["removed", m] for m in METHODS if ("removed", m) in result.scores}
    if scored:
        entry["psnr"] = {m: psnr_of_mse(s.squared / s.pixels) for m, s in scored.items()}
        entry["ssim"] = {m: s.similarity / s.pixels for m, s in scored.items()}
        for name in DETAIL_FIGURES:
            entry[name] = {m: detail_figures([result.details["removed", m]])[name] for m in scored}
    return entry


def _finite_mean(values: Iterable[float]) -> float:
    """Frames that agree exactly have infinite decibels and would hide all others: the mean is over the finite ones."""
    everything = list(values)
    finite = [v for v in everything if math.isfinite(v)]
    return sum(finite) / len(finite) if finite else (everything[0] if everything else float("nan"))
