"""What each part of the reconstruction earns: one left out or done otherwise at a time, on both truth scenes.

    python benchmarks/reconstruction/ablations.py

Each run is a process of its own, `draft` quality (28 runs in a quarter of an hour), every eighth frame held out. Results go to
benchmarks/results/ablations.json and ablations.png.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from benchmarks.reconstruction.reconstruction import SCENES, measure  # noqa: E402

ROWS: dict[str, list[str]] = {
    "all": [],
    "no adaptation": ["--variant", "fixed"],
    "no D-SSIM": ["--without", "dssim"],
    "no L_s": ["--without", "semantic"],
    "no L_d": ["--without", "distortion"],
    "no L_ds": ["--without", "label_distortion"],
    "no L_n": ["--without", "normal"],
    "no L_alpha": ["--without", "opacity"],
    "no L_d, L_ds, L_n": ["--without", "distortion,label_distortion,normal"],
    "soft labels": ["--variant", "soft_labels"],
    "3D Gaussians": ["--variant", "ellipsoids"],
    "random start": ["--variant", "random_start"],
    "no density control": ["--variant", "no_growth"],
    "no pruning": ["--variant", "no_pruning"],
}


def row(measured: dict) -> dict[str, float | str | None]:
    """What the table shows of a run."""
    held, geometry = measured["held_out"], measured["geometry"]
    return {
        "drive": measured["drive"], "cpu_seconds": measured["cpu_seconds"], "surfels": measured["surfels"], "psnr": held["psnr"],
        "ssim": held["ssim"], "miou": held["miou"], "f_score_0.25": geometry["f_score_0.25"],
        "f_score_0.05": geometry["f_score_0.05"], "chamfer_m": geometry["chamfer_m"],
        "unobserved_iou": geometry.get("unobserved_iou"), "iterations": measured["choices"]["iterations"]["chosen"]
    }


def plot(rows: list[dict], target: Path) -> None:
    """Bars: each figure's difference from the whole method, by scene."""
    figures = [("psnr", "PSNR, dB"), ("miou", "mIoU"), ("f_score_0.05", "F at 0.05 m"), ("unobserved_iou", "unobserved IoU"),
               ("cpu_seconds", "seconds of a core")]
    names = [n for n in ROWS if n != "all" and any(r["row"] == n for r in rows)]
    figure, axes = plt.subplots(1, len(figures), figsize=(3.1 * len(figures), 0.36 * len(names) + 1.2), sharey=True)
    for axis, (key, title) in zip(axes, figures, strict=True):
        for k, scene in enumerate(SCENES):
            base = next(r[key] for r in rows if r["row"] == "all" and r["drive"] == scene)
            found = {r["row"]: r[key] for r in rows if r["drive"] == scene}
            places = [i + 0.2 - 0.4 * k for i, n in enumerate(names) if n in found]
            axis.barh(places, [found[n] - base for n in names if n in found], 0.38, label=scene.replace("_", " "))
        axis.axvline(0, color="black", linewidth=0.8)
        axis.set_title(f"{title}, against all", fontsize=9)
        axis.tick_params(labelsize=8)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    axes[-1].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(target, dpi=110)


def main() -> None:
    """Measure all rows, or those named on the command line; rows measured before are kept."""
    target = ROOT / "benchmarks/results/ablations.json"
    rows = json.loads(target.read_text())["rows"] if target.is_file() else []
    wanted = sys.argv[1:] or list(ROWS)
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted:
            for scene in SCENES:
                measured = measure(scene, "draft", Path(folder), ROWS[name])
                rows = [r for r in rows if (r["row"], r["drive"]) != (name, scene)]
                rows.append({"row": name, **row(measured)})
                target.write_text(json.dumps({"machine": measured["machine"], "rows": rows}, indent=1) + "\n")
    plot(rows, target.with_suffix(".png"))


if __name__ == "__main__":
    main()
