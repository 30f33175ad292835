"""Faults: what a run loses when it is killed, starved of memory or disk, refused, robbed of its files, or not alone.

    python benchmarks/robustness/faults.py [--times 1.0] [--only WORDS] [--seed 0]

Real processes, signals, limits, mounts and control groups; for some of them one must be root. Each fault hits runs of a tiny drive
at random moments (fault_kinds/). Then the workspace is run to its end, and its files must be those of a run that nobody
disturbed, byte for byte; no finished stage may be made again; and the disturbed run must have said one line. Results go to
benchmarks/results/faults.json, after every fault.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks.robustness.fault_kinds import drives, resources, signals, together  # noqa: E402
from benchmarks.robustness.fault_kinds.bench import Bench  # noqa: E402
from benchmarks.robustness.fault_kinds.runs import Tally  # noqa: E402
from tests.drives.tiny_drive import make_tiny_drive  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks/results/faults.json"
Kind = Callable[[Bench, Callable[[int], int]], Iterator[Tally]]


def _one(make: Callable[[Bench, int], Tally], usual: int) -> Kind:
    def tallies(bench: Bench, times: Callable[[int], int]) -> Iterator[Tally]:
        yield make(bench, times(usual))

    return tallies


def _several(make: Callable[[Bench, int], Iterator[Tally]], usual: int) -> Kind:
    return lambda bench, times: make(bench, times(usual))


KINDS: dict[str, Kind] = {
    "versions": lambda bench, times: iter([drives.versions(bench)]),
    "two": _one(lambda bench, n: together.together(bench, 2, n), 20),
    "no-locks": _several(together.no_locks, 3),
    "read-only": _several(resources.read_only, 4),
    "kill": _one(lambda bench, n: signals.ended_by(bench, signal.SIGKILL, n), 25),
    "terminate": _one(lambda bench, n: signals.ended_by(bench, signal.SIGTERM, n), 15),
    "interrupt": _one(lambda bench, n: signals.ended_by(bench, signal.SIGINT, n), 15),
    "memory": _one(resources.address_space, 20),
    "killer": _one(resources.control_group, 10),
    "disk": _one(resources.full_disk, 20),
    "names": lambda bench, times: drives.hard_names(bench),
    "changed": _several(drives.changed, 4),
    "clock": _one(drives.clock, 2),
    "future": _one(drives.times_of_the_future, 2),
    "three": _one(lambda bench, n: together.together(bench, 3, n), 6),
    "half": _one(lambda bench, n: together.together(bench, 2, n, half=True), 6),
}


def main() -> None:
    """Bring the faults, one kind after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=float, default=1.0, help="of the usual number of times")
    parser.add_argument("--only", default=",".join(KINDS), help=f"some of {','.join(KINDS)}")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    # Not in the user's folders, and measured once.
    root = Path(tempfile.mkdtemp(prefix="faults_"))
    os.environ["UNVEIL_CACHE"] = str(root / "cache")
    (root / "cache").mkdir()
    (root / "cache").chmod(0o777)
    drive = make_tiny_drive(root / "drive").parent
    bench = Bench(root, drive, np.random.default_rng(arguments.seed))
    held = json.loads(arguments.output.read_text())["faults"] if arguments.output.is_file() else {}
    result: dict[str, Any] = {"machine": machine(), "faults": held}
    bench.begin()
    result["undisturbed_s"], result["files"] = round(bench.whole_s, 1), len(bench.wanted)
    bad = False
    for kind in arguments.only.split(","):
        begun = time.monotonic()
        for tally in KINDS[kind](bench, lambda usual: max(1, round(usual * arguments.times))):
            result["faults"][tally.fault] = tally
            bad |= bool(tally.lost or tally.wrong or tally.changed or tally.unclear)
            print(f"{kind} {time.monotonic() - begun:.0f} s", json.dumps(tally.to_json()), flush=True)
            rows = {k: t.to_json() if isinstance(t, Tally) else t for k, t in result["faults"].items()}
            write_json_atomic(arguments.output, {**result, "faults": rows})
    shutil.rmtree(root, ignore_errors=True)
    raise SystemExit(int(bad))


if __name__ == "__main__":
    main()
