"""Many frames at full size: a whole run on a PandaSet sequence in which the car stands now and then, beside its forecast.

    python benchmarks/machine/full_size.py PANDASET/002 [--frames 100] [--quality standard] [--cache DIR] [--keep DIR]

Some of the sequence's frames are taken twice, so that every camera has as many as are asked for; LiDAR sweeps and boxes go with
their frames. All cameras of the sequence are used, and what can be removed goes. Time, memory and disk by
stage, and what the first line of the run had said of them, go to benchmarks/results/full_size.json.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402

RESULTS = ROOT / "benchmarks/results/full_size.json"


def slower(count: int, wanted: int) -> list[int]:
    """Indices of ``count`` frames for ``wanted`` ones, in order: some twice, as if the car had stood there for a moment."""
    return [k * count // wanted for k in range(wanted)]


def repeated(sequence: Path, frames: int, target: Path) -> None:
    """Write the sequence with so many frames a camera, in PandaSet's layout."""
    lists = [p for p in sequence.rglob("*.json") if isinstance(json.loads(p.read_text()), list)]
    count = len(json.loads((sequence / "lidar/poses.json").read_text()))
    order = slower(count, frames)
    for path in sequence.rglob("*"):
        new = target / path.relative_to(sequence)
        if path.is_dir():
            new.mkdir(parents=True, exist_ok=True)
            continue
        new.parent.mkdir(parents=True, exist_ok=True)
        if path in lists:
            values = json.loads(path.read_text())
            chosen = [values[i] for i in order]
            if path.name == "timestamps.json":
                step = (values[-1] - values[0]) / (count - 1)
                chosen = [values[0] + k * step for k in range(frames)]
            new.write_text(json.dumps(chosen))
        elif not path.name.split(".")[0].isdigit():
            shutil.copyfile(path, new)
    for k, i in enumerate(order):
        for path in sequence.rglob(f"{i:02d}.*"):
            shutil.copyfile(
                path, target / path.relative_to(sequence).with_name(path.name.replace(f"{i:02d}", f"{k:02d}", 1))
            )


def run(drive: Path, workspace: Path, quality: str) -> dict[str, Any]:
    """Run the program; returns what it took and what it had expected."""
    shutil.rmtree(workspace, ignore_errors=True)
    command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", str(workspace), "--quality", quality]
    command += ["--cameras", "all", "--remove", "vehicle,human"]
    begun = time.perf_counter()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"}
    process = subprocess.Popen(command, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{drive}: the run ended with {process.returncode}")
    events = [json.loads(line) for line in (workspace / "events.jsonl").read_text().splitlines()]
    expected = next(e["forecast"] for e in events if "forecast" in e)
    stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    imported = read_imported(workspace / "drive").frames
    return {
        "frames": len(imported),
        "working_size": [imported[0].camera.width, imported[0].camera.height],
        "seconds": round(time.perf_counter() - begun, 1),
        "processor_seconds": round(usage.ru_utime + usage.ru_stime, 1),
        "peak_memory_mb": round(usage.ru_maxrss / 1024, 1),
        "workspace_mb": round(sum(p.stat().st_size for p in workspace.rglob("*") if p.is_file()) / 2**20, 1),
        "expected": {**expected, "seconds_in_all": round(sum(expected["seconds"].values()), 1)},
        "stages": {
            name: {k: s[k] for k in ("seconds", "peak_memory_mb")} for name, s in stages.items() if "seconds" in s
        },
    }


def main() -> None:
    """Make the drive if it is not there yet, run, and record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--frames", type=int, default=100, help="of each camera")
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--keep", type=Path, default=None, help="keep the workspace here")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    drive = arguments.cache / f"pandaset_{arguments.sequence.name}_{arguments.frames}"
    if not drive.is_dir():
        new = Path(tempfile.mkdtemp(prefix=".pandaset_", dir=arguments.cache))
        repeated(arguments.sequence, arguments.frames, new)
        new.rename(drive)
    folder = arguments.keep or Path(tempfile.mkdtemp(dir=arguments.cache))
    row = {"quality": arguments.quality, **run(drive, folder / drive.name, arguments.quality)}
    write_json_atomic(arguments.output, {"machine": machine(), **row})
    print(json.dumps(row))


if __name__ == "__main__":
    main()
