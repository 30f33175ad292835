"""The GPU, checked and measured by one command.

    python benchmarks/machine/gpu.py --seconds 460 [--parts imports,checks,passes,…] [--cache DIR] [-o FILE]

On a machine with an NVIDIA GPU: what is imported; every plane and gradient against float64; passes of 100,000 to 2 million surfels
at three sizes (beside gsplat's 2DGS kernels, if `pip install gsplat` was done); the sample street at two qualities; a drive of the
paper's number and size of frames (198 of 484x320) by `unveil run --device cuda`; training steps; kernels one by one; the backend's
tests. What no longer fits into --seconds is left out, and a run that takes longer is ended; both are said in the results. Nothing
is fetched: packages that the machine lacks are named, and whole runs, which need them, are left out.

Without a GPU the kernels are compiled for all cards, the bytes of a step are counted, and planes and gradients are checked in
Triton's interpreter; no speed is measured. `--tiny` asks all that a card is asked, in seconds and in the interpreter if need be: it
proves the script before a card's time is spent.

Results are written after each part; of a part that fails the error is recorded, and the others go on.
benchmarks/results/gpu.json keeps what was found for each card, and without one.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")

from benchmarks.machine import gpu_parts as parts  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks/results/gpu.json"
Part = Callable[[parts.Extent, parts.TimeLeft], Any]
SAMPLE = (("draft", "cuda", 60.0), ("standard", "cuda", 60.0))
ON_THE_PROCESSOR = (("draft", "cpu", 100.0),)
"""Qualities and devices of the sample street, with the seconds that each takes at least."""


def known_parts(cache: Path, tiny: bool) -> dict[str, tuple[float, Part]]:
    """The parts in their order, each with the seconds under which it is not begun."""
    anywhere: dict[str, tuple[float, Part]] = {
        "imports": (0.0, parts.imports),
        "checks": (30.0, parts.checks),
        "bytes": (20.0, parts.count_bytes),
        "kernels": (60.0, parts.kernels),
    }
    if not parts.CARD and not tiny:
        return anywhere
    on_a_card: dict[str, tuple[float, Part]] = {
        "imports": anywhere["imports"],
        "checks": anywhere["checks"],
        "passes": (5.0, parts.passes),
        "sample": (60.0, partial(parts.sample, runs=SAMPLE)),
        "drive": (60.0, partial(parts.long_drive, cache=cache)),
        "step": (15.0, parts.step),
        "kernels one by one": (20.0, parts.one_by_one),
        "sample on the processor": (100.0, partial(parts.sample, runs=ON_THE_PROCESSOR)),
        "tests": (60.0, parts.tests),
        "bytes": anywhere["bytes"],
        "kernels": anywhere["kernels"],
    }
    if not parts.CARD:  # CUDA's own clocks, and tests that the suite has anyway
        del on_a_card["kernels one by one"], on_a_card["tests"]
    return {name: (0.0, part) for name, (_, part) in on_a_card.items()} if tiny else on_a_card


def found_by(name: str, needs: float, part: Part, extent: parts.Extent, left: parts.TimeLeft) -> Any:
    """What a part finds; why it was left out; or what went wrong."""
    if why := left.skips(needs):
        return {"skipped": why}
    if name in ("sample", "drive", "sample on the processor") and (lacks := parts.missing()):
        return {
            "skipped": f"left out: {', '.join(lacks)} not found; install them, or put a folder with them into PYTHONPATH"
        }
    try:
        return part(extent, left)
    except Exception as error:  # what a card does not do is a result; the other parts are asked all the same
        traceback.print_exc()
        return {"failed": f"{type(error).__name__}: {error}"[:2000]}


def main() -> None:
    """Run the parts, and keep what they find."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", help="some of them, by commas; all by default")
    parser.add_argument("--seconds", type=float, help="that all may take; what no longer fits is left out")
    parser.add_argument("--tiny", action="store_true", help="all so small that the interpreter does it")
    parser.add_argument("--cache", type=Path, help="for the drive that is made")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    given = parser.parse_args()
    if given.tiny and given.output == RESULTS:
        parser.error("--tiny measures nothing that is kept: name a file with -o")
    left = parts.TimeLeft(given.seconds)
    if parts.CARD is None:
        print("torch sees no NVIDIA GPU: the kernels run in Triton's interpreter; no speed is measured")
    with tempfile.TemporaryDirectory() as folder:
        known = known_parts(given.cache or Path(folder), given.tiny)
        wanted = given.parts.split(",") if given.parts else list(known)
        if unknown := [name for name in wanted if name not in known]:
            parser.error(f"no such part here: {', '.join(unknown)}; there are {', '.join(known)}")
        found = facts()
        for name in wanted:
            print(f"{name} ...", flush=True)
            begun = time.perf_counter()
            needs, part = known[name]
            found[name] = found_by(name, needs, part, parts.TINY if given.tiny else parts.WHOLE, left)
            print(f"{name}: {time.perf_counter() - begun:.0f} s", flush=True)
            keep(found, given.output)
    not_whole = [n for n in wanted if isinstance(found[n], dict) and ("failed" in found[n] or "skipped" in found[n])]
    for name in not_whole:
        print(f"{name}: {found[name].get('failed') or found[name]['skipped']}")
    print(f"{parts.CARD or 'no card'}: {', '.join(wanted)} in {given.output}")
    if any("failed" in found[name] for name in not_whole):
        raise SystemExit(1)


def facts() -> dict[str, Any]:
    """The machine and its card."""
    found: dict[str, Any] = {"machine": machine()}
    if parts.CARD:
        of = torch.cuda.get_device_properties(0)
        found["card"] = {"name": parts.CARD, "memory_gb": round(of.total_memory / 1e9, 1)}
        found["card"] |= {"capability": f"{of.major}.{of.minor}", "cuda": torch.version.cuda}
    return found


def keep(found: dict[str, Any], output: Path) -> None:
    """Put what was found into the file, in the place of what it says of the same parts and card."""
    document = json.loads(output.read_text()) if output.is_file() else {}
    place = parts.CARD or "no card"
    document[place] = {**document.get(place, {}), **found}
    write_json_atomic(output, document)


if __name__ == "__main__":
    main()
