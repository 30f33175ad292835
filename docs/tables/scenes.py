"""The scene and its rasterizer: reconstructions, ablations, passes on a processor and on a card, textures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from docs.tables.read import db, percent, results, table

__all__ = [
    "ablations",
    "card_passes",
    "card_runs",
    "gpu_share",
    "rasterizer",
    "reconstruction",
    "textures",
    "torch_step",
]

CARD = "NVIDIA H100 80GB HBM3"
SCENES = ("parked_street", "country_road")
ABLATIONS = ("all", "no adaptation", "no D-SSIM", "no L_s", "no L_n", "soft labels", "3D Gaussians", "random start") + (
    "no density control",
)
"""Rows of ablations.json that the page shows: those that change something, and adaptation."""


def _street_and_road(
    rows: Iterable[dict[str, Any]], name: Callable[[dict[str, Any]], str]
) -> dict[str, list[dict[str, Any]]]:
    """The rows of both sample scenes by name, in this order."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda r: r["drive"] != SCENES[0]):
        found.setdefault(name(row), []).append(row)
    return found


def _pair(rows: list[dict[str, Any]], shown: Callable[[dict[str, Any]], str]) -> str:
    return " / ".join(shown(row) for row in rows)


def reconstruction() -> str:
    """Every eighth frame held out, street / road."""

    def named(run: dict[str, Any]) -> str:
        wrong = f", {percent(run['salt'])} of the labels wrong" if run["salt"] else ""
        return f"`{run['quality']}`{', fixed recipe' if run['variant'] == 'fixed' else ''}{wrong}"

    rows = [
        (
            name,
            _pair(of, lambda r: f"{r['seconds']:.0f}") + " s",
            _pair(of, lambda r: f"{r['surfels'] / 1000:.0f}"),
            _pair(of, lambda r: f"{r['held_out']['psnr']:.1f}") + " dB",
            _pair(of, lambda r: f"{r['held_out']['miou']:.2f}"),
            _pair(of, lambda r: f"{100 * r['geometry']['f_score_0.05']:.0f}") + " %",
            _pair(of, lambda r: f"{100 * r['geometry']['chamfer_m']:.0f}") + " cm",
        )
        for name, of in _street_and_road(results("reconstruction")["runs"], named).items()
    ]
    return table(("", "time", "surfels, thousands", "PSNR", "mIoU", "F-score at 5 cm", "Chamfer"), rows)


def ablations() -> str:
    """Parts of the reconstruction left out, one at a time, street / road."""
    rows = [
        (
            name,
            _pair(of, lambda r: f"{r['cpu_seconds']:.0f}") + " s",
            _pair(of, lambda r: f"{r['psnr']:.1f}") + " dB",
            _pair(of, lambda r: f"{r['miou']:.2f}"),
            _pair(of, lambda r: f"{100 * r['f_score_0.05']:.0f}") + " %",
        )
        for name, of in _street_and_road(results("ablations")["rows"], lambda row: row["row"]).items()
        if name in ABLATIONS
    ]
    return table(("", "CPU time", "PSNR", "mIoU", "F-score at 5 cm"), rows)


def rasterizer() -> str:
    """Forward and backward of 100,000 surfels at 480x320: time against error."""
    names = {
        "specified, all planes": "all planes",
        "rgb, alpha": "colour and alpha",
        "stop at light 1e-3": "all planes, transmittance to 1e-3 instead of 1e-4",
        "cut at alpha 1/128": "all planes, cut at alpha 1/128 instead of 1/255",
        "whole boxes, no exact reach": "all planes, without exact support radius",
        "C++ yardstick": "C++ of the same planes",
    }
    found = {row["name"]: row for row in results("raster")["knobs"]["forward_and_backward"]}
    rows = []
    for key, name in names.items():
        row = found[key]
        gradient = row.get("gradient_error")
        shown = None if gradient is None else f"{gradient:.0e}"
        rows.append((name, f"{row['ms']:.0f} ms", f"{row['ratio']:.2f}", f"{row['rgb_error']:.0e}", shown))
    return table(("", "time", "of the C++", "error of colours", "of gradients"), rows)


def card_passes() -> str:
    """Milliseconds of a pass of geometry on a card, and how long gsplat's kernels take beside it."""
    found: dict[int, dict[str, str]] = {}
    for row in results("gpu")[CARD]["passes"]:
        if "ms" not in row:  # left out, as the time was over
            continue
        ms = [
            row["ms"][f"{planes}: forward and backward"]["ms"]
            for planes in ("rgb, alpha, geometry", "gsplat 2DGS, colour, normal, distortion")
        ]
        size = "x".join(map(str, row["size"]))
        found.setdefault(row["surfels"], {})[size] = f"{ms[0]:.1f} ms / {ms[1]:.1f} ms"
    sizes = list(next(iter(found.values())))
    return table(
        ("surfels", *sizes), ((f"{n:,}", *(of.get(size) for size in sizes)) for n, of in sorted(found.items()))
    )


def card_runs() -> str:
    """Whole runs of the sample street on a card and on its processor."""
    rows = []
    of_card = results("gpu")[CARD]
    runs = {**of_card["sample"], **of_card["sample on the processor"]}
    for name, run in sorted(runs.items(), key=lambda kv: (kv[0].split()[0], kv[0].endswith("cpu"))):
        if "removed" not in run:  # left out or cut off, as the time was over
            continue
        card = f"{run['card_memory_mb'] / 1000:.1f} GB" if "cuda" in name else None
        rows.append(
            (
                name.replace("cuda", "the card").replace("cpu", "its processor"),
                f"{run['seconds']:.0f} s",
                db(run["removed"]),
                card,
            )
        )
    return table(("sample street", "time", "PSNR", "card's memory"), rows)


def gpu_share() -> str:
    """Which part of a run on two cores a card can take."""
    names = {"002": "PandaSet, 28 frames of 1920x1080", "parked_street": "sample street"}
    rows = []
    for run in sorted(results("gpu_share")["runs"], key=lambda r: r["drive"] == "002"):
        times = (f"{run[k]:.0f} s" for k in ("seconds", "steps", "rendering"))
        rows.append((f"{names[run['drive']]}, `{run['quality']}`", *times, f"{run['most']:.1f} times"))
    return table(("", "whole run", "training steps", "other rendering", "at most faster"), rows)


def torch_step() -> str:
    """The step in torch's operations against the fused kernels, both on a processor, in one sentence."""
    changes = [results("torch_step")[scene]["psnr_difference"] for scene in SCENES]
    return (
        "On a card the losses and Adam are torch's own operations. On a processor they train as the fused kernels do:"
        f" {changes[0]:+.2f} dB on the street, {changes[1]:+.2f} dB on the road."
    )


def textures() -> str:
    """Meshes with textures beside coloured vertices, against clean frames: PSNR / SSIM."""
    rows = []
    for row in results("textures")["rows"]:
        unseen, every = row["unseen frames"], row["all frames"]
        shown = (
            f"{f['psnr']:.1f} dB / {f['ssim']:.2f}"
            for f in (unseen["vertex colours"], unseen["texture"], every["texture"])
        )
        rows.append((f"{row['triangles']:,}", *shown, f"{row['unwrap_s']:.0f} + {every['paint_s']:.0f} s"))
    return table(
        ("triangles", "vertex colours", "texture, other frames", "texture, all frames", "unwrap + paint"), rows
    )
