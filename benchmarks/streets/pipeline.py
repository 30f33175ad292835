"""Whole ways to an empty street, side by side on both truth scenes: ours and the baselines of the paper.

    python benchmarks/streets/pipeline.py [SCENES...] [ROWS...]

Each row is a process of its own and begins with one reconstruction per scene and quality. Rows are taken at `standard`, ours at
`draft` and `high`, too. Results go to benchmarks/results/pipeline.json after every row, the plots beside it; rows measured before
are kept, so that single ones can be measured anew. `UNVEIL_KEEP=DIR` keeps all frames, to be looked at.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from unveil_core.bench.pipeline import plot_points
from unveil_core.bench.plot import quality_plot
from unveil_core.bench.rows import ROWS

ROOT = Path(__file__).resolve().parents[2]
SCENES = ("parked_street", "country_road")
RUNS = (*((name, "standard") for name in ROWS), ("ours", "draft"), ("ours", "high"))


def measure(scene: str, row: str, quality: str, folder: Path) -> dict:
    """One row on one scene."""
    target = folder / "measured.json"
    command = [
        sys.executable, "-m", "unveil_core", "bench", "pipeline", str(ROOT / "sample_scenes" / scene),
        "--quality", quality, "--rows", row, "--scene", str(folder / f"{scene}_{quality}"), "-o", str(target)
    ]
    if os.environ.get("UNVEIL_KEEP"):
        command += ["--keep", str(Path(os.environ["UNVEIL_KEEP"]) / scene / quality)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    measured: dict = json.loads(target.read_text())
    return measured


def kept(runs: list[dict], measured: dict) -> list[dict]:
    """The runs with a new one in the place of its predecessor."""
    name = (measured["drive"], measured["quality"], measured["rows"][0]["row"])
    others = [r for r in runs if (r["drive"], r["quality"], r["rows"][0]["row"]) != name]
    return [*others, measured]


def main() -> None:
    """Measure all rows, or those named on the command line."""
    target = ROOT / "benchmarks/results/pipeline.json"
    runs = json.loads(target.read_text())["runs"] if target.is_file() else []
    scenes = [name for name in sys.argv[1:] if name in SCENES]
    rows = [name for name in sys.argv[1:] if name not in SCENES]
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes or SCENES:
            for row, quality in RUNS:
                if rows and row not in rows:
                    continue
                measured = measure(scene, row, quality, Path(folder))
                runs = kept(runs, measured)
                target.write_text(json.dumps({"runs": runs}, indent=1) + "\n")
                one = measured["rows"][0]
                figures = one.get("regions", {}).get("removed", {})
                print(scene, quality, row, one["status"], one.get("seconds"), figures, flush=True)
            here = [r for r in runs if r["drive"] == scene]
            quality_plot(plot_points(here), target.with_name(f"pipeline_{scene}.png"), title=scene.replace("_", " "))


if __name__ == "__main__":
    main()
