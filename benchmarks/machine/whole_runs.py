"""What a state of the program takes for whole runs, beside an earlier one: seconds, processor seconds and peak memory, in turns.

    python benchmarks/machine/whole_runs.py DRIVE --before CHECKOUT [--rounds 1] [--name NAME] [-- OPTIONS OF unveil run]

CHECKOUT is the repository as it was, for instance a `git worktree`; this Python runs it, each run as a process of its own. First
each state runs the sample street at `draft`, so that all kernels are compiled. Of several rounds the fastest counts. Rows in
benchmarks/results/whole_runs.json of the same drive are replaced.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.real_drives.trees import environment_of  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402

RESULTS = ROOT / "benchmarks/results/whole_runs.json"
SAMPLE = ROOT / "sample_scenes/parked_street"


def whole_run(checkout: Path, drive: Path, options: list[str]) -> dict[str, Any]:
    """One run by the code of a checkout."""
    with tempfile.TemporaryDirectory() as folder:
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", f"{folder}/ws", *options],
            check=True,
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment_of(checkout),
        )
        seconds, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
        stages = json.loads((Path(folder) / "ws/workspace.json").read_text())["stages"]
    return {
        "commit": program_commit(checkout),
        "seconds": round(seconds, 1),
        "processor_seconds": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
        "peak_memory_mb": round(max(s.get("peak_memory_mb", 0.0) for s in stages.values())),
        "load_before": round(os.getloadavg()[0], 1),
        "stages": {name: round(s["seconds"], 1) for name, s in stages.items() if "seconds" in s},
    }


def _at_dashes(words: list[str]) -> tuple[list[str], list[str]]:
    """Words before the first ``--``, and those after it."""
    at = words.index("--") if "--" in words else len(words)
    return words[:at], words[at + 1 :]


def main() -> None:
    """Run in turns, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--before", type=Path, required=True, help="the repository as it was")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--name", help="of the drive, for the row; its folder's otherwise")
    given, options = _at_dashes(sys.argv[1:])
    arguments = parser.parse_args(given)
    states = (arguments.before.resolve(), ROOT)
    for checkout in states:
        whole_run(checkout, SAMPLE, ["--quality", "draft"])
    runs: dict[Path, list[dict[str, Any]]] = {checkout: [] for checkout in states}
    for _ in range(arguments.rounds):
        for checkout in states:
            runs[checkout].append(whole_run(checkout, arguments.drive.resolve(), options))
            print(json.dumps(runs[checkout][-1]), flush=True)
    before, after = (min(found, key=lambda run: run["seconds"]) for found in runs.values())
    row = {
        "drive": arguments.name or arguments.drive.name,
        "options": " ".join(options),
        "share_of_time": round(after["seconds"] / before["seconds"], 3),
        "share_of_processor_time": round(after["processor_seconds"] / before["processor_seconds"], 3),
        "before": before,
        "after": after,
    }
    found = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {"rows": []}
    rows = [r for r in found["rows"] if r["drive"] != row["drive"]]
    write_json_atomic(RESULTS, {"machine": machine(), "rows": [*rows, row]})


if __name__ == "__main__":
    main()
