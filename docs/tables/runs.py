"""Whole runs: of the sample scenes, beside other methods, by quality and on staged streets; times of typical shots."""

from __future__ import annotations

from typing import Any

from docs.tables.read import both, db, results, seconds, table

__all__ = ["cost", "hard_streets", "methods", "presets", "shots", "whole_runs"]

SCENES = ("parked_street", "country_road")
METHODS = {
    "shift_map": "shift-map (OpenCV), frame by frame",
    "per_frame": "Unveil's patch-based fill, frame by frame",
    "flow": "along optical flow (ProPainter)",
    "spin_nerf": "SPIn-NeRF in 2DGS",
    "infusion": "Infusion",
    "transfer_reverse": "later frame by depth, reversed in time",
    "paper": "StreetUnveiler without networks, reversed in time",
    "paper_independent": "the same, each frame independently",
    "paper_ellipsoids": "the same on 3D Gaussians",
    "ours": "**Unveil**",
    "ellipsoids": "Unveil on 3D Gaussians",
}
"""Rows of pipeline.json that the page shows, in its order."""


def shots() -> str:
    """Three typical shots: what they took on two cores."""
    fitted = {run["run"]: run for run in results("forecast")["fitted"]}
    sample, clip = fitted["parked_street draft"], fitted["002 standard"]
    long = results("full_size")
    rows = [
        ("the sample street", 28, "384x256", "draft", sample["seconds"], sample["memory_mb"], sample["disk_mb"]),
        ("a clip", clip["frames"], "1920x1080", "standard", clip["seconds"], clip["memory_mb"], clip["disk_mb"]),
        (
            "two cameras",
            long["frames"],
            "1920x1080",
            "standard",
            long["seconds"],
            long["peak_memory_mb"],
            long["workspace_mb"],
        ),
    ]
    return table(
        ("shot", "frames", "quality", "time", "memory", "workspace"),
        (
            (
                what,
                f"{frames} of {size}",
                f"`{quality}`",
                seconds(time),
                f"{memory / 1000:.1f} GB",
                f"{disk / 1000:.1f} GB",
            )
            for what, frames, size, quality, time, memory, disk in rows
        ),
    )


def _sample(scene: str) -> Any:
    return next(run for run in results("sample_street")["runs"] if run["drive"] == scene)


def whole_runs() -> str:
    """Both sample scenes against the true empty street."""
    names = {
        "ours": "**Unveil, clean frames**",
        "render": "Unveil, the 3D scene rendered",
        "shift_map": "shift-map (OpenCV)",
        "telea": "Telea (OpenCV)",
        "input": "the photographs themselves",
    }
    street, road = (_sample(scene)["regions"] for scene in SCENES)
    rows = [
        (
            name,
            *(both(street[region][key]) for region in ("removed", "unseen", "seen_elsewhere")),
            both(road["removed"][key]),
        )
        for key, name in names.items()
    ]
    free = [both(_sample(scene)["free_views"]["free_removed"]) for scene in SCENES]
    rows.append(("Unveil, from beside and above the path", free[0], None, None, free[1]))
    return table(("", "parked street", "never seen", "seen elsewhere", "country road"), rows)


def cost() -> str:
    """Shadows, flicker, masks, time and memory of the same runs."""
    runs = [_sample(scene) for scene in SCENES]
    flicker = [run["flicker"] for run in runs]
    rows = [
        ("cast shadows beside the objects", *(db(run["regions"]["cast_shadow"]["ours"]) for run in runs)),
        ("the same, shadows kept", *(db(run["regions"]["cast_shadow"]["input"]) for run in runs)),
        (
            "flicker: Unveil / shift-map / the true street",
            *(f"{f['ours']:.1f} / {f['shift_map']:.1f} / {f['truth']:.1f}" for f in flicker),
        ),
        ("overlap (IoU) of *never seen* with the truth", *(f"{run['unobserved_mask_iou']:.2f}" for run in runs)),
        ("time, at the lowest priority beside other work", *(f"{run['seconds_together']:.0f} s" for run in runs)),
        ("peak memory", *(f"{run['peak_memory_mb']:.0f} MB" for run in runs)),
        ("pixels changed outside the masks", *(run["untouched"]["max"] for run in runs)),
    ]
    return table(("", "parked street", "country road"), rows)


def _row(scene: str, name: str, quality: str = "standard") -> tuple[Any, Any]:
    for run in results("pipeline")["runs"]:
        if run["drive"] == scene and run["quality"] == quality and run["rows"][0]["row"] == name:
            return run, run["rows"][0]
    raise KeyError(name)


def methods() -> str:
    """Other methods on the same reconstructed scenes."""
    rows = []
    for key, name in METHODS.items():
        cells = []
        for scene in SCENES:
            _, row = _row(scene, key)
            cells += [both(row["regions"]["removed"]), f"{row['flicker']:.1f}"]
        rows.append((name, *cells))
    return table(("", "parked street", "flicker", "country road", "flicker"), rows)


def presets() -> str:
    """The three qualities, until the frames are written."""
    rows = []
    for quality in ("draft", "standard", "high"):
        cells = []
        for scene in SCENES:
            _, row = _row(scene, "ours", quality)
            cells += [both(row["regions"]["removed"]), f"{row['seconds']:.0f} s", f"{row['peak_memory_mb']:.0f} MB"]
        rows.append((f"`{quality}`", *cells))
    return table(("", "parked street", "time", "memory", "country road", "time", "memory"), rows)


def hard_streets() -> str:
    """Ten staged streets, PSNR inside the removed pixels."""
    rows = []
    for case in results("hard_streets")["cases"].values():
        others = case["others_in_the_gone_region"]
        rows.append((case["what"], db(case["regions"]["gone"]), db(others["shift_map"]), db(others["telea"])))
    return table(("", "Unveil", "shift-map", "Telea"), rows)
