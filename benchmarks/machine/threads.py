"""More processors: a whole run with one and with two, the share of each stage that stays serial, and what follows for more.

    python benchmarks/machine/threads.py [--drive sample_scenes/parked_street] [--quality draft]

Each run is a process of its own that may use so many processors. By Amdahl's law a stage of which the share s is serial takes
s + (1 - s) / n of the time on n processors; s follows from the two runs. What it says of 8 and 16 is an expectation: memory
bandwidth is not in it. Results in benchmarks/results/threads.json.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks/results/threads.json"
EXPECTED = (4, 8, 16)


def seconds_by_stage(drive: Path, quality: str, processors: set[int]) -> dict[str, float]:
    """Run the program on some processors only; returns the seconds of each stage."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", f"{folder}/ws", "--quality", quality]
        subprocess.run(
            [*command, "--remove", "vehicle"],
            check=True,
            stdout=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"},
            preexec_fn=lambda: os.sched_setaffinity(0, processors),
        )
        stages = json.loads((Path(folder) / "ws/workspace.json").read_text())["stages"]
    return {name: stage["seconds"] for name, stage in stages.items()}


def row(one: float, two: float) -> dict[str, Any]:
    """Seconds with one and two processors, the serial share, and the expected seconds with more."""
    serial = min(max(2 * two / one - 1, 0.0), 1.0)
    more = {str(n): round(one * (serial + (1 - serial) / n), 2) for n in EXPECTED}
    return {"1": one, "2": two, "serial_share": round(serial, 3), "expected": more}


def main() -> None:
    """Run twice, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drive", type=Path, default=ROOT / "sample_scenes/parked_street")
    parser.add_argument("--quality", default="draft")
    arguments = parser.parse_args()
    there = sorted(os.sched_getaffinity(0))
    one, two = (seconds_by_stage(arguments.drive, arguments.quality, set(there[:n])) for n in (1, 2))
    stages = {name: row(one[name], two[name]) for name in one if one[name] > 0.5}
    whole = {
        "1": round(sum(one.values()), 1),
        "2": round(sum(two.values()), 1),
        "expected": {str(n): round(sum(s["expected"][str(n)] for s in stages.values()), 1) for n in EXPECTED},
    }
    found = {"machine": machine(), "drive": arguments.drive.name, "quality": arguments.quality}
    write_json_atomic(RESULTS, {**found, "stages": stages, "whole": whole})
    print(json.dumps({"stages": stages, "whole": whole}, indent=1))


if __name__ == "__main__":
    main()
