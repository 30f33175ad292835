"""Many drives on one machine: eight small ones with one worker and with two, one of which is killed.

    python benchmarks/machine/batch.py [--drives 8] [--quality draft] [--cache DIR]

Each worker runs its tasks as whole processes. Of the run with two workers, the process of the first task that runs is killed; all
drives must be done all the same, the task be named as tried again, and a second start find nothing to do. Results in
benchmarks/results/batch.json.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import psutil

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.worlds.box_worlds import make_box_world  # noqa: E402
from tests.worlds.long_street import long_street, long_way  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.farm.manifest import Batch, plan_batch  # noqa: E402
from unveil_core.farm.run import run_batch  # noqa: E402
from unveil_core.farm.state import state_of  # noqa: E402
from unveil_core.farm.status import batch_status  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402

RESULTS = ROOT / "benchmarks/results/batch.json"
SIZE, FRAMES, RAYS = (240, 160), 20, 1500


def make_drives(count: int, folder: Path) -> list[Path]:
    """Streets of boxes of growing length."""
    drives = []
    for k in range(count):
        frames = FRAMES + 2 * k
        drives.append(
            make_box_world(folder / f"street_{k}", long_street(float(frames)), long_way(frames, size=SIZE), rays=RAYS)
        )
    return drives


def kill_first(batch: Batch, killed: list[str]) -> None:
    """Kill the process of the first task that runs, once it has run for a while."""
    while not killed:
        for task in batch.tasks:
            state = state_of(batch, task)
            if state.status == "running":
                time.sleep(5.0)
                for process in psutil.Process(state.process).children():
                    if process.cmdline()[-len(task.arguments) - 1 : -1] == list(task.arguments):
                        process.kill()
                killed.append(task.id)
                return
        time.sleep(0.1)


def measured(batch: Batch, workers: int, *, kill: bool) -> dict[str, Any]:
    """Run a batch; seconds, what was killed and tried again, and what a second start did."""
    lines: list[str] = []
    killed: list[str] = []
    if kill:
        threading.Thread(target=kill_first, args=(batch, killed), daemon=True).start()
    begun = time.perf_counter()
    failed = run_batch(batch, lines.append, workers=workers)
    seconds = time.perf_counter() - begun
    status = batch_status(batch)
    again: list[str] = []
    begun = time.perf_counter()
    run_batch(batch, again.append, workers=workers)
    return {
        "workers": workers,
        "seconds": round(seconds, 1),
        "failed": failed,
        "tasks": status["tasks"],
        "killed_worker_of": killed,
        "tried_again": [t for d in status["drives"] for t in d["tried_again"]],
        "second_start": again,
        "second_start_seconds": round(time.perf_counter() - begun, 2),
    }


def main() -> None:
    """Run with one worker, with two, and with two of which one dies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=8)
    parser.add_argument("--quality", default="draft", choices=("draft", "standard", "high"))
    parser.add_argument("--cache", type=Path, default=None)
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(dir=arguments.cache))
    drives = make_drives(arguments.drives, folder / "drives")
    settings = RunSettings(quality=arguments.quality, remove=("vehicle",), memory="512M")
    options = (f"--quality={arguments.quality}", "--remove=vehicle", "--memory=512M")
    rows = []
    for name, workers, kill in (("one", 1, False), ("two", 2, False), ("killed", 2, True)):
        batch = plan_batch(drives, folder / name, settings, options)
        batch.save()
        rows.append(measured(batch, workers, kill=kill))
        print(json.dumps(rows[-1]), flush=True)
    write_json_atomic(
        RESULTS,
        {
            "machine": machine(),
            "drives": arguments.drives,
            "frames": [FRAMES + 2 * k for k in range(arguments.drives)],
            "size": list(SIZE),
            "quality": arguments.quality,
            "speed_up_of_two_workers": round(rows[0]["seconds"] / rows[1]["seconds"], 2),
            "runs": rows,
        },
    )
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
