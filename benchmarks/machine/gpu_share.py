"""What of a run a GPU can take: seconds of each stage in training steps, in rendering, and in what the processor does in any case.

    python benchmarks/machine/gpu_share.py [QUALITY...] [--drive PATH] [--frames A:B]

On the sample street, or another drive, on the processor. Results go to benchmarks/results/gpu_share.json, where those of other
drives and qualities are kept; ``most`` is how much faster a run can be at best, with a GPU that takes no time at all (Amdahl
1967).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.optimize.training.trainer import Optimization  # noqa: E402
from unveil_core.pipeline.run import run  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402
from unveil_core.raster import on_device  # noqa: E402
from unveil_core.remove import remains  # noqa: E402

DRIVE = ROOT / "sample_scenes" / "parked_street"
RESULTS = ROOT / "benchmarks/results/gpu_share.json"


class Clock:
    """Seconds in some functions, by stage.

    Threads that render at once count each for itself, as they do where a GPU would take their work.
    """

    def __init__(self) -> None:
        self.stage = ""
        self.spent: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))

    def timed(self, kind: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, whose time counts as ``kind``."""

        def call(*arguments: Any, **named: Any) -> Any:
            begun = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                self.spent[self.stage][kind] += time.perf_counter() - begun

        return call

    def heard(self, event: dict[str, object]) -> None:
        """An event of the run: it tells the stage."""
        self.stage = str(event["stage"])


def measure(drive: Path, frames: str | None, quality: str, folder: Path) -> dict[str, Any]:
    """One run.

    Args:
        frames: which of the drive, as for ``unveil run``; None = all.
    """
    clock = Clock()
    changed = [(Optimization, "step", "steps"), (on_device, "render", "rendering"), (remains, "_draw", "rendering")]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in changed]
    load = machine()["load_before"]
    for owner, name, kind in changed:
        setattr(owner, name, clock.timed(kind, getattr(owner, name)))
    try:
        settings = RunSettings(quality=quality, device="cpu", frames=frames)
        space = run(drive, folder / quality, settings, reporter=clock.heard)
    finally:
        for owner, name, function in before:
            setattr(owner, name, function)
    stages = {}
    for name, stage in space.state()["stages"].items():
        spent = clock.spent[name]
        own = {kind: round(spent[kind], 2) for kind in ("steps", "rendering")}
        stages[name] = {"seconds": stage["seconds"], **own}
    total = sum(s["seconds"] for s in stages.values())
    taken = sum(s["steps"] + s["rendering"] for s in stages.values())
    return {
        "quality": quality,
        "load_before": load,
        "stages": stages,
        "seconds": round(total, 1),
        "steps": round(sum(s["steps"] for s in stages.values()), 1),
        "rendering": round(sum(s["rendering"] for s in stages.values()), 1),
        "most": round(total / (total - taken), 2),
    }


def main() -> None:
    """Measure the qualities named on the command line, draft and standard by default."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("qualities", nargs="*", default=["draft", "standard"])
    parser.add_argument("--drive", type=Path, default=DRIVE)
    parser.add_argument("--frames")
    given = parser.parse_args()
    runs = json.loads(RESULTS.read_text())["runs"] if RESULTS.is_file() else []
    with tempfile.TemporaryDirectory() as folder:
        for quality in given.qualities:
            row = {"drive": given.drive.name, **measure(given.drive, given.frames, quality, Path(folder))}
            print(json.dumps(row), flush=True)
            runs = [r for r in runs if (r["drive"], r["quality"]) != (row["drive"], quality)] + [row]
    RESULTS.write_text(json.dumps({"machine": machine(), "runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()
