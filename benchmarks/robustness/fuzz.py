"""Fuzzing: every reader on many damaged and hostile files; what is not read is refused in one line, and nothing else happens.

    python benchmarks/robustness/fuzz.py [--reader NAME …] [--kind text,binary,drive] [--inputs N] [--minutes M]
        [--seed 0] [--resume]

Sound files of each reader are changed by their structure (tests/fuzz): values of JSON, words and lines of text, bytes, headers,
parts of archives. Counted are inputs that end in anything but a reader's own error in one line ("crash"), that take longer than
five seconds ("hang"; a whole drive 20), that take more than 128 MB beyond what the process holds ("memory"; a whole drive 512), and
that are read although they must not be, as a pose of NaN or a name that leads out of the workspace, or are refused in words that
no terminal can show ("wrong"). Inputs that were found are made small and written to ``--findings`` with their traces; the same
seed and number give the same input. Results go to benchmarks/results/fuzz.json, a reader at a time, for many runs take hours;
``--resume`` leaves out readers that it has with as many inputs and nothing found.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.fuzz.reader import Reader  # noqa: E402
from tests.fuzz.run import HANG_S, MEMORY_MB, fuzz  # noqa: E402
from tests.fuzz.table import INPUTS, READERS  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks/results/fuzz.json"
PARSERS = ("numpy", "pyarrow", "opencv-contrib-python-headless")
"""Packages that read beside this one; their versions are noted, too."""


def is_done(row: dict[str, Any] | None, inputs: int) -> bool:
    """Whether a row of the results needs no other run."""
    return row is not None and row["inputs"] >= inputs and not any(row[k] for k in ("crash", "hang", "memory", "wrong"))


def main() -> None:
    """Try the readers that are asked for, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reader", nargs="+", choices=list(READERS), metavar="NAME", help=", ".join(READERS))
    parser.add_argument("--kind", default="text,binary,drive", help="of the readers, separated by commas")
    parser.add_argument("--inputs", type=int, help=f"of each reader; by default {INPUTS}")
    parser.add_argument("--minutes", type=float, help="for each reader at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--findings", type=Path, default=Path(tempfile.gettempdir()) / "unveil_fuzz")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    kinds = arguments.kind.split(",")
    chosen = [READERS[n] for n in arguments.reader] if arguments.reader else [r for r in READERS.values() if r.kind in kinds]
    found = 0
    for reader in chosen:
        inputs = arguments.inputs or reader.inputs or INPUTS[reader.kind]
        if arguments.resume and is_done(known_rows(arguments.output).get(reader.name), inputs):
            continue
        row = measured(reader, inputs, arguments)
        rows = known_rows(arguments.output)  # now, for others may have written meanwhile
        found += sum(row[k] for k in ("crash", "hang", "memory", "wrong"))
        rows = {name: {**rows, reader.name: row}[name] for name in READERS if name in {*rows, reader.name}}
        about = {**machine(), "parsers": {name: version(name) for name in PARSERS}}
        limits = {"seconds": HANG_S, "memory_mb": MEMORY_MB}
        write_json_atomic(arguments.output, {"machine": about, "limits": limits, "readers": rows})
    raise SystemExit(int(found > 0))


def known_rows(path: Path) -> dict[str, Any]:
    """The rows of a file of results, by reader."""
    rows: dict[str, Any] = json.loads(path.read_text())["readers"] if path.is_file() else {}
    return rows


def measured(reader: Reader, inputs: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """Try one reader; its row of the results."""
    seconds = None if arguments.minutes is None else 60 * arguments.minutes
    tally = fuzz(reader, inputs, seed=arguments.seed, seconds=seconds, findings=arguments.findings)
    row = {
        "kind": reader.kind, "inputs": tally.tried, "read": tally.read, **tally.counts,
        "seconds": round(tally.seconds, 1), "seed": arguments.seed,
    }  # fmt: skip
    print(time.strftime("%H:%M:%S"), reader.name, json.dumps(row), flush=True)
    return row


if __name__ == "__main__":
    main()
