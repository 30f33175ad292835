"""Kills: a run that is killed again and again comes to the files of one that is not, and loses little work.

    python benchmarks/kills.py [--kills 50] [--frames 36] [--size 240x160] [--seed 0]

A street of boxes in three blocks is unveiled at ``draft``, killed with SIGKILL at random moments, and started again each time,
until it ends. Then all files but the logs must be those of a run that nobody disturbed, byte for byte. Results go to
benchmarks/results/kills.json.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from sample_scenes.box_worlds import make_box_world  # noqa: E402
from sample_scenes.long_street import long_street, long_way  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = HERE / "results" / "kills.json"
BLOCK_M, CHECKPOINT_S = 12.0, 3.0
"""Length of a block, metres, and seconds between checkpoints: a small drive is cut as a long one is."""
OWN = ("workspace.json", "events.jsonl", ".digests.json", ".lock", "metrics.json", "report")
"""What tells times, and differs from run to run."""
CODE = f"""
import sys
from pathlib import Path
from unveil_core.base import checkpoint
from unveil_core.ground import blocks
blocks.BLOCK_M, checkpoint.EVERY_S = {BLOCK_M}, {CHECKPOINT_S}
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
run(Path(sys.argv[1]), Path(sys.argv[2]), RunSettings(quality="draft", remove=("vehicle",), memory="64M"))
"""


def start(drive: Path, workspace: Path) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(HERE.parent), "OMP_WAIT_POLICY": "PASSIVE"}
    return subprocess.Popen([sys.executable, "-c", CODE, str(drive), str(workspace)], env=environment)


def digests(workspace: Path) -> dict[str, str]:
    """Of all files that a run must reproduce."""
    files = [p for p in sorted(workspace.rglob("*")) if p.is_file()]
    names = {p.relative_to(workspace).as_posix(): p for p in files}
    return {n: hashlib.sha256(p.read_bytes()).hexdigest() for n, p in names.items() if not n.startswith(OWN)}


def where(workspace: Path) -> tuple[str, float]:
    """The stage that runs, and the time of the last event."""
    path = workspace / "events.jsonl"
    lines = path.read_text().splitlines() if path.is_file() else []
    for line in reversed(lines):
        try:
            event = json.loads(line)
        except ValueError:
            continue
        return str(event["stage"]), float(event["t"])
    return "start", 0.0


def main() -> None:
    """Run once undisturbed, once with kills, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--size", default="240x160")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    width, height = (int(n) for n in arguments.size.split("x"))
    root = Path(tempfile.mkdtemp(prefix="kills_"))
    way = long_way(arguments.frames, size=(width, height))
    drive = make_box_world(root / "drive", long_street(float(arguments.frames)), way, rays=3000)
    begun = time.perf_counter()
    if start(drive, root / "whole").wait():
        raise SystemExit("the undisturbed run failed")
    whole_s = time.perf_counter() - begun
    generator = np.random.default_rng(arguments.seed)
    kills: list[dict[str, Any]] = []
    begun = time.perf_counter()
    while True:
        process = start(drive, root / "killed")
        patience = float(generator.uniform(2.0, 2.5 * whole_s / max(arguments.kills, 1) + 6.0))
        try:
            code = process.wait(patience if len(kills) < arguments.kills else None)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            stage, _ = where(root / "killed")
            kills.append({"after_s": round(patience, 1), "stage": stage})
            print(len(kills), kills[-1], flush=True)
            continue
        if code:
            raise SystemExit(f"a run that was begun again ended with {code}")
        break
    killed_s = time.perf_counter() - begun
    one, other = digests(root / "whole"), digests(root / "killed")
    different = sorted(n for n in one.keys() | other.keys() if one.get(n) != other.get(n))
    result = {
        "machine": machine(),
        "kills": len(kills),
        "stages": {s: sum(k["stage"] == s for k in kills) for s in dict.fromkeys(k["stage"] for k in kills)},
        "undisturbed_s": round(whole_s, 1),
        "with_kills_s": round(killed_s, 1),
        "lost_s_a_kill": round((killed_s - whole_s) / max(len(kills), 1), 2),
        "checkpoint_s": CHECKPOINT_S,
        "files": len(one),
        "different": different,
    }
    write_json_atomic(arguments.output, result)
    print(json.dumps(result, indent=1))
    shutil.rmtree(root, ignore_errors=True)
    raise SystemExit(int(bool(different)))


if __name__ == "__main__":
    main()
