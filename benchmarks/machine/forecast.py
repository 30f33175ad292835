"""The forecast's weights, fitted to whole runs, and how far off it is on runs that it was not fitted to.

    python benchmarks/machine/forecast.py --fit WORKSPACE… [--memory WORKSPACE…] [--check WORKSPACE…]

Workspaces of finished runs, whose drives are still there. `--fit` writes unveil_core/forecast/costs.json; runs of `--memory` count
for that alone: they ran beside other work, or not to their end. `--check` compares other runs with it, each stage and
the whole. Both are recorded in benchmarks/results/forecast.json. A quality that only one run has takes the weights of `standard`,
scaled by that run.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.drives import open_drive  # noqa: E402
from unveil_core.drives.importing.whole_drive import localized  # noqa: E402
from unveil_core.drives.scale_and_up import place_drive  # noqa: E402
from unveil_core.forecast import costs  # noqa: E402
from unveil_core.forecast.machine import measured_seconds  # noqa: E402
from unveil_core.forecast.workload import Workload  # noqa: E402
from unveil_core.optimize.presets import PRESETS  # noqa: E402
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS  # noqa: E402
from unveil_core.pipeline.forecasting import workload_of  # noqa: E402
from unveil_core.pipeline.graph import STAGES  # noqa: E402
from unveil_core.pipeline.settings import QUALITIES, RunSettings  # noqa: E402

RESULTS = ROOT / "benchmarks/results/forecast.json"
GUESS, PIXELS = 0.15, 2.5
"""Weight of a guess beside a run, and how much more four times the pixels are taken to cost: part of the work does not see them."""
LEAST_S, LEAST_MB = 0.5, 10.0
"""What is shorter or smaller counts as if it were so: its share of the whole is not worth a percentage."""


@dataclass(frozen=True)
class Run:
    """A finished run: its name, its size, the seconds of its stages, its peak memory and the size of its workspace."""

    name: str
    work: Workload
    seconds: dict[str, float]
    memory_mb: float
    disk_mb: float

    @staticmethod
    def of(root: Path) -> Run:
        state = json.loads((root / "workspace.json").read_text())
        settings = RunSettings.from_json(state["settings"])
        drive = open_drive(Path(state["drive"]), settings.drive_options)
        placement = place_drive(drive, scale=settings.scale, up=settings.up)
        work = workload_of(localized(drive, placement), settings)
        stages = {name: s for name, s in state["stages"].items() if "seconds" in s}
        return Run(
            f"{Path(state['drive']).name} {settings.quality}",
            work,
            {name: s["seconds"] for name, s in stages.items()},
            max(s["peak_memory_mb"] for s in stages.values()),
            sum(p.stat().st_size for p in root.rglob("*") if p.is_file()) / 2**20,
        )


def weights_of(
    works: list[Workload], terms: Callable[[Workload], tuple[float, ...]], found: list[float], least: float
) -> list[float]:
    """Weights of 0 and more with the least squared relative error.

    A few runs do not tell frames from pixels. So each run also says, with little weight, what it would have taken with twice the
    frames (twice as much) and with four times the pixels (see :data:`PIXELS`).
    """
    more = [w.with_frames(2 * w.frames) for w in works], [w.with_side(2 * w.side) for w in map(_reducible, works)]
    rows = np.array([terms(w) for part in (works, *more) for w in part])
    values = np.array([v * times for times in (1.0, 2.0, PIXELS) for v in found])
    weight = np.repeat((1.0, GUESS, GUESS), len(found)) / np.maximum(values, least)
    unit = rows.max(axis=0) + 1e-9
    return [float(f"{w:.4g}") for w in nnls(rows / unit * weight[:, None], values * weight)[0] / unit]


def _reducible(work: Workload) -> Workload:
    """The same with images that were reduced to their own size: larger ones would be worked on larger."""
    if work.side < max(work.size):
        return work
    return replace(work, side=max(work.size), size=(4 * work.size[0], 4 * work.size[1]))


def fit(runs: list[Run], others: list[Run]) -> dict[str, Any]:
    """The table of weights by quality; ``others``: further runs, for memory alone."""
    table: dict[str, Any] = {
        "reference_seconds": round(measured_seconds(), 5),
        "seconds": {},
        "memory_mb": {},
        "disk_mb": {},
    }
    for quality in sorted(QUALITIES, key=lambda q: q != "standard"):
        some = [r for r in runs if r.work.quality == quality]
        if quality != "standard" and len(some) < 2:
            add_scaled(table, quality, some)
            continue
        table["seconds"][quality] = {}
        for stage in STAGES:
            have = [r for r in some if stage.name in r.seconds]
            table["seconds"][quality][stage.name] = weights_of(
                [r.work for r in have], costs.time_terms, [r.seconds[stage.name] for r in have], LEAST_S
            )
        for_memory = [*some, *(r for r in others if r.work.quality == quality)]
        held = [r.memory_mb - costs.held_mb(r.work) for r in for_memory]
        works = [r.work for r in for_memory]
        table["memory_mb"][quality] = weights_of(works, costs.memory_terms, held, LEAST_MB)
        works, disk = [r.work for r in some], [r.disk_mb for r in some]
        table["disk_mb"][quality] = weights_of(works, costs.disk_terms, disk, LEAST_MB)
    return table


def add_scaled(table: dict[str, Any], quality: str, runs: list[Run]) -> None:
    """Weights of a quality that one run has, or none: those of `standard`, scaled by it, or by the steps of the optimization."""
    for name in ("seconds", "memory_mb", "disk_mb"):
        table[name][quality] = table[name]["standard"]
    seconds = dict(table["seconds"]["standard"])
    for stage, presets in (("reconstruct", PRESETS), ("reoptimize", REOPTIMIZE_PRESETS)):
        more = presets[quality].iterations / presets["standard"].iterations
        seconds[stage] = [float(f"{w * more:.4g}") for w in seconds[stage]]
    table["seconds"][quality] = seconds
    if not runs:
        return
    (run,) = runs

    def scaled(weights: list[float], terms: tuple[float, ...], found: float) -> list[float]:
        usual = float(np.dot(weights, terms))
        return [float(f"{w * found / usual:.4g}") for w in weights] if usual > 0 else weights

    work, usual = run.work, table["seconds"]["standard"]
    times, memory, disk = (f(run.work) for f in (costs.time_terms, costs.memory_terms, costs.disk_terms))
    table["seconds"][quality] = {
        name: scaled(weights, times, run.seconds[name]) if name in run.seconds else weights
        for name, weights in usual.items()
    }
    table["memory_mb"][quality] = scaled(table["memory_mb"]["standard"], memory, run.memory_mb - costs.held_mb(work))
    table["disk_mb"][quality] = scaled(table["disk_mb"]["standard"], disk, run.disk_mb)


def compared(run: Run) -> dict[str, Any]:
    """Expected and found of a run, by the weights that lie there."""
    expected = costs.seconds_of(run.work)
    return {
        "run": run.name,
        "frames": run.work.frames,
        "size": list(run.work.size),
        "seconds": round(sum(run.seconds.values()), 1),
        "seconds_expected": round(sum(expected[name] for name in run.seconds), 1),
        "memory_mb": round(run.memory_mb),
        "memory_mb_expected": round(costs.peak_memory_mb(run.work)),
        "disk_mb": round(run.disk_mb),
        "disk_mb_expected": round(costs.disk_mb(run.work)),
        "stages": {name: [s, round(expected[name], 1)] for name, s in run.seconds.items()},
    }


def main() -> None:
    """Fit, check, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fit", type=Path, nargs="*", default=[])
    parser.add_argument("--memory", type=Path, nargs="*", default=[])
    parser.add_argument("--check", type=Path, nargs="*", default=[])
    arguments = parser.parse_args()
    results: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    if arguments.fit:
        runs = [Run.of(root) for root in arguments.fit]
        others = [Run.of(root) for root in arguments.memory]
        write_json_atomic(Path(costs.__file__).parent / "costs.json", fit(runs, others))
        costs._weights.cache_clear()
        results["fitted"] = [compared(run) for run in runs]
    if arguments.check:
        results["checked"] = [compared(Run.of(root)) for root in arguments.check]
    write_json_atomic(RESULTS, {**results, "machine": machine()})
    for row in [*results.get("fitted", []), *results.get("checked", [])]:
        print({k: v for k, v in row.items() if k != "stages"})


if __name__ == "__main__":
    main()
