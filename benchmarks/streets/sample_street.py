"""Whole runs on both truth scenes: seconds and peak memory against PSNR and SSIM to the true empty street.

    python benchmarks/streets/sample_street.py [draft standard high]

Each run is a process of its own; results go to benchmarks/results/sample_street.json with machine and versions.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from unveil_core.bench.timing import machine

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks/results/sample_street.json"


SCENES = ("parked_street", "country_road")


def measure(scene: str, quality: str, folder: Path) -> dict[str, object]:
    """Run a scene at one quality and read what the run recorded."""
    workspace, drive = folder / f"{scene}_{quality}", ROOT / "sample_scenes" / scene
    command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", str(workspace), "--quality", quality, "--baselines"]
    load = os.getloadavg()[0]
    subprocess.run(command, check=True, cwd=ROOT)
    state = json.loads((workspace / "workspace.json").read_text())
    metrics = json.loads((workspace / "metrics.json").read_text())
    stages = state["stages"]
    return {
        "drive": scene,
        "quality": quality,
        "load_before": round(load, 2),
        "seconds": {name: stage["seconds"] for name, stage in stages.items()},
        "seconds_together": round(sum(stage["seconds"] for stage in stages.values()), 1),
        "peak_memory_mb": max(stage["peak_memory_mb"] for stage in stages.values()),
        "regions": {
            region: values["methods"] for region, values in metrics["truth"]["regions"].items() if region != "whole"
        },
        "unobserved_mask_iou": metrics["truth"]["unobserved_mask_iou"],
        "flicker": {m: v["absolute"] for m, v in metrics["flicker"]["methods"].items()},
        "free_views": metrics["free_views"]["regions"],
        "untouched": metrics["untouched"],
        "versions": state["versions"],
    }


def main() -> None:
    """Measure the qualities named on the command line, standard by default."""
    qualities = sys.argv[1:] or ["standard"]
    with tempfile.TemporaryDirectory() as folder:
        rows = [measure(scene, quality, Path(folder)) for quality in qualities for scene in SCENES]
    document = {"machine": machine(), "runs": rows}
    RESULTS.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
