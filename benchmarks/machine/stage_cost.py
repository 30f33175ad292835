"""What a change makes of the cost of stages: processor seconds and peak memory before and after it, in turns.

    python benchmarks/machine/stage_cost.py WORKSPACE --before CHECKOUT --stages deliver,mesh [--rounds 2] [--every 3]

CHECKOUT is the repository as it was, for instance a `git worktree`. Each run is a process of its own, with two threads, that calls
a stage of a finished workspace with a folder of its own for what it writes; the workspace stays as it is. The sum over all threads
counts, of user and system: it depends little on what else the machine does. Of these, `main_seconds` are those of the thread that
called the stage: what is not shared out is all there, what is shared out half of it. Before anything counts each runs once, so that
all kernels are compiled. Of the rounds the least is kept. Rows in benchmarks/results/stage_cost.json of the same drive and stage
are replaced.
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
from unveil_core.bench.timing import machine, program_commit  # noqa: E402

RESULTS = ROOT / "benchmarks/results/stage_cost.json"
CHILD = """
import json, resource, sys, time
from pathlib import Path
checkout, stage, root, folder, every, drive = sys.argv[1:]
sys.path.insert(0, checkout)
import unveil_core
assert Path(unveil_core.__file__).is_relative_to(checkout)
import cv2
from unveil_core.base.parallel import threads
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.run import stage_named
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import StageContext
from unveil_core.workspace.files import frame_file
from unveil_core.workspace.workspace import Workspace

def used():
    u = resource.getrusage(resource.RUSAGE_SELF)
    return u.ru_utime + u.ru_stime

workspace = Workspace(Path(root))
frames = read_imported(workspace.drive_dir, points=False).frames
done = 0
for i, frame in enumerate(frames):
    if i % int(every):
        path = frame_file(Path(folder) / "frames", frame)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    else:
        done += 1
kept = workspace.state().get("settings", {})
known = RunSettings.__dataclass_fields__
given = {k: tuple(v) if isinstance(v, list) else v for k, v in kept.items() if k in known and k != "keyframes"}
context = StageContext(workspace, RunSettings(**given), lambda *a, **k: None, Path(drive), Path(folder))
run = stage_named(stage).run
run.load()
cv2.setNumThreads(2)
with threads(2):
    begun, own = used(), time.thread_time()
    run(context)
    seconds, own = used() - begun, time.thread_time() - own
print(json.dumps({
    "seconds": round(seconds, 2), "main_seconds": round(own, 2), "frames": done,
    "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
}))
"""


def once(checkout: Path, stage: str, workspace: Path, every: int) -> dict[str, Any]:
    """One run of a stage by the code of a checkout."""
    drive = json.loads((workspace / "workspace.json").read_text())["drive"]
    with tempfile.TemporaryDirectory(dir=workspace.parent) as folder:
        output = subprocess.run(
            [sys.executable, "-c", CHILD, str(checkout), stage, str(workspace), folder, str(every), drive],
            check=True,
            stdout=subprocess.PIPE,
            env={**os.environ, "OMP_WAIT_POLICY": "PASSIVE", "OMP_NUM_THREADS": "2"},
        ).stdout
    return dict(json.loads(output.splitlines()[-1]))


def least(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The run with the fewest processor seconds."""
    return min(runs, key=lambda run: run["seconds"])


def main() -> None:
    """Run in turns, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--before", type=Path, required=True, help="the repository as it was")
    parser.add_argument("--stages", required=True, help="names, with commas between")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--every", type=int, default=1, help="of the frames that are delivered, every so many")
    parser.add_argument("--name", help="of the drive, for the row; the workspace's otherwise")
    arguments = parser.parse_args()
    workspace, before = arguments.workspace.resolve(), arguments.before.resolve()
    drive = arguments.name or workspace.name
    found = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {"rows": []}
    for stage in arguments.stages.split(","):
        runs: dict[Path, list[dict[str, Any]]] = {before: [], ROOT: []}
        for turn in range(arguments.rounds + 1):
            for checkout, rounds in runs.items():
                one = once(checkout, stage, workspace, arguments.every)
                rounds += [one] if turn else []
        row = {
            "drive": drive,
            "stage": stage,
            "frames": runs[ROOT][0]["frames"],
            "before": {"commit": program_commit(before), **least(runs[before])},
            "after": {"commit": program_commit(ROOT), **least(runs[ROOT])},
        }
        print(json.dumps(row), flush=True)
        others = [r for r in found["rows"] if (r["drive"], r["stage"]) != (drive, stage)]
        found = {"machine": machine(), "rows": [*others, row]}
        write_json_atomic(RESULTS, found)


if __name__ == "__main__":
    main()
