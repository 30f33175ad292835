"""Kills: a run that is killed again and again comes to the files of one that is not, and loses little work.

    python benchmarks/robustness/kills.py [--kills 50] [--frames 36] [--size 240x160] [--seed 0] [--iterations N]

A street of boxes in three blocks is unveiled at ``draft`` once undisturbed, and once killed with SIGKILL at moments drawn at random
within every stage, and started again each time, until it ends. Then the files of both must be the same, byte for byte. Times and
memory differ from run to run: they are taken out of workspace.json, metrics.json and the report's page before these are compared,
and events.jsonl, a log with times, is left out. So are in metrics.json and on the page the figures of one baseline, shift-map: now
and then OpenCV's code fills the same picture differently. Results go to benchmarks/results/kills.json.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.worlds.box_worlds import make_box_world  # noqa: E402
from tests.worlds.long_street import long_street, long_way  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks/results/kills.json"
BLOCK_M, CHECKPOINT_S = 12.0, 3.0
"""Length of a block, metres, and seconds between checkpoints: a small drive is cut as a long one is."""
LEFT_OUT = ("events.jsonl", ".digests.json", ".lock")
"""The log, sizes and times of change of files, and who held the workspace last."""
TIMES = frozenset({"t", "seconds", "peak_memory_mb", "baseline_seconds_per_frame"})
"""Entries of JSON files that say how long something took, and what memory it used at most."""
BASELINE = "shift_map"
SHOWN = re.compile(
    r"width:\s*[\d.]+%|\b\d+(\.\d+)?\s(s|MB|GB)\b|\b\d+ min \d\d s\b|\b\d+ h \d\d min\b"
    r"|<tr><th>shift-map</th>.*?</tr>|<svg class=\"chart\".*?</svg>",
    re.DOTALL,
)
"""The same on the report's page, with the bars beside them; rows of the baseline, and the chart in which it is a line."""
CODE = f"""
import sys
from pathlib import Path
from unveil_core.base.resume import checkpoint
from unveil_core.ground import blocks
blocks.BLOCK_M, checkpoint.EVERY_S = {BLOCK_M}, {CHECKPOINT_S}
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
drive, workspace, steps = sys.argv[1:]
settings = RunSettings(quality="draft", remove=("vehicle",), memory="64M", iterations=int(steps) or None, baselines=True)
run(Path(drive), Path(workspace), settings)
"""


def start(drive: Path, workspace: Path, iterations: int) -> subprocess.Popen[bytes]:
    """Begin a run, or go on with it; ``iterations``: of the reconstruction, 0 = as many as it chooses."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"}
    command = [sys.executable, "-c", CODE, str(drive), str(workspace), str(iterations)]
    return subprocess.Popen(command, env=environment)


def contents(workspace: Path) -> dict[str, str]:
    """Digests of what a run must reproduce, by file."""
    found = {}
    for path in sorted(workspace.rglob("*")):
        name = path.relative_to(workspace).as_posix()
        if path.is_file() and name not in LEFT_OUT:
            found[name] = hashlib.sha256(determined(name, path.read_bytes(), workspace)).hexdigest()
    return found


def determined(name: str, content: bytes, workspace: Path) -> bytes:
    """A file without what it says of times, memory and the baseline, and without the folder's own name."""
    if name in ("workspace.json", "metrics.json"):
        content = json.dumps(without_chance(json.loads(content))).encode()
    elif name == "report/index.html":
        content = SHOWN.sub("", content.decode()).encode()
    return content.replace(str(workspace).encode(), b"")


def without_chance(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_chance(v) for k, v in value.items() if k not in TIMES and BASELINE not in k}
    return [without_chance(v) for v in value] if isinstance(value, list) else value


def seconds_of(workspace: Path) -> dict[str, float]:
    """What each stage of a finished run took, in the order in which they ran."""
    stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    order: dict[str, None] = dict.fromkeys(e["stage"] for e in events(workspace, 0))
    return {name: stages[name]["seconds"] for name in order if name in stages}


def planned(seconds: Mapping[str, float], kills: int, generator: np.random.Generator) -> list[tuple[str, float]]:
    """Stages and the seconds of work in them after which they are killed: as many in each stage, the rest in the longest.

    Within a stage the moments are drawn evenly over the time that it takes undisturbed. A run goes on where it was killed, so each
    comes after the seconds that lie between it and the one before.
    """
    share, rest = divmod(kills, len(seconds))
    longest = sorted(seconds, key=lambda name: -seconds[name])[:rest]
    found = []
    for name, whole in seconds.items():
        moments = np.sort(generator.uniform(0.0, whole, share + (name in longest)))
        found += [(name, float(wait)) for wait in np.diff(moments, prepend=0.0)]
    return found


def events(workspace: Path, offset: int) -> list[dict[str, Any]]:
    """The events that were logged behind so many bytes."""
    path = workspace / "events.jsonl"
    if not path.is_file():
        return []
    with path.open("rb") as stream:
        stream.seek(offset)
        lines = stream.read().splitlines()
    found = []
    for line in lines:
        try:
            found.append(json.loads(line))
        except ValueError:  # cut short by a kill, or not yet written to its end
            continue
    return found


def kill_within(process: subprocess.Popen[bytes], workspace: Path, stage: str, wait: float, order: list[str]) -> Any:
    """Kill a run after so many seconds of a stage; returns where it was, or None where it had ended before.

    A stage that was nearly finished may end sooner: then the kill meets the next one.
    """
    path = workspace / "events.jsonl"
    offset = path.stat().st_size if path.is_file() else 0
    later = set(order[order.index(stage) :])
    begun, starting, until = time.monotonic(), None, None
    while process.poll() is None:
        if until is None:
            said = events(workspace, offset)
            if said and starting is None:
                starting = round(time.monotonic() - begun, 2)
            if any(e["stage"] in later and e["message"] != "up to date" for e in said):
                until = time.monotonic() + wait
        elif time.monotonic() >= until:
            process.send_signal(signal.SIGKILL)
            process.wait()
            last = ([e for e in events(workspace, offset) if e["stage"] in order] or [{}])[-1]
            where = {k: last.get(k) for k in ("stage", "done", "total")}
            return {"planned": stage, "after_s": round(wait, 2), "starting_s": starting, **where}
        time.sleep(0.01)
    if process.returncode:
        raise SystemExit(f"a run that was begun again ended with {process.returncode}: {workspace}")
    return None


def main() -> None:
    """Run once undisturbed, once with kills, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--size", default="240x160")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--iterations", type=int, default=0, help="of the reconstruction; 0 = as many as it chooses")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    width, height = (int(n) for n in arguments.size.split("x"))
    root = Path(tempfile.mkdtemp(prefix="kills_"))
    way = long_way(arguments.frames, size=(width, height))
    drive = make_box_world(root / "drive", long_street(float(arguments.frames)), way, rays=3000)
    begun = time.perf_counter()
    steps = arguments.iterations
    if start(drive, root / "whole", steps).wait():
        raise SystemExit("the undisturbed run failed")
    whole_s = time.perf_counter() - begun
    seconds = seconds_of(root / "whole")
    print(f"undisturbed: {whole_s:.1f} s", seconds, flush=True)
    kills: list[dict[str, Any]] = []
    begun = time.perf_counter()
    for stage, wait in planned(seconds, arguments.kills, np.random.default_rng(arguments.seed)):
        killed = kill_within(start(drive, root / "killed", steps), root / "killed", stage, wait, list(seconds))
        if killed is None:
            break
        kills.append(killed)
        print(len(kills), killed, flush=True)
    code = start(drive, root / "killed", steps).wait()
    if code:
        raise SystemExit(f"a run that was begun again ended with {code}: {root}")
    killed_s = time.perf_counter() - begun
    one, other = contents(root / "whole"), contents(root / "killed")
    different = sorted(n for n in one.keys() | other.keys() if one.get(n) != other.get(n))
    result = {
        "machine": machine(),
        "kills": len(kills),
        "stages": {name: sum(k["stage"] == name for k in kills) for name in seconds},
        "seconds": seconds,
        "undisturbed_s": round(whole_s, 1),
        "with_kills_s": round(killed_s, 1),
        # Most of it goes into starting the program, up to its first word; the rest is work that is done again.
        "lost_s_a_kill": round((killed_s - whole_s) / max(len(kills), 1), 2),
        "starting_s_a_kill": round(float(np.mean([k["starting_s"] for k in kills] or [0.0])), 2),
        "checkpoint_s": CHECKPOINT_S,
        "files": len(one),
        "different": different,
        "moments": kills,
    }
    write_json_atomic(arguments.output, result)
    print(json.dumps({k: v for k, v in result.items() if k != "moments"}, indent=1))
    if different:
        raise SystemExit(f"{len(different)} files differ: {root}")
    shutil.rmtree(root, ignore_errors=True)


if __name__ == "__main__":
    main()
