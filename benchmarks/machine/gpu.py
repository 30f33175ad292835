"""The GPU, checked and measured by one command.

    python benchmarks/machine/gpu.py [--parts kernels,bytes,checks,tests,speed,step,sample,drive] [--cache DIR] [-o FILE]

Where an NVIDIA GPU is, all parts run: every plane and gradient against float64, passes and training steps of 100,000 to 2
million surfels (beside gsplat's 2DGS kernels, if `pip install gsplat` was done), the sample street, and a drive of the paper's
number and size of frames (198 of 484x320) by `unveil run --device cuda`. Without one, the kernels are compiled for all
cards, the bytes of a step are counted, and planes and gradients are checked in Triton's interpreter; no speed is measured.
Results are written after each part; of a part that fails the error is recorded, and the others go on.
benchmarks/results/gpu.json keeps what was found for each card, and without one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
CARD = torch.cuda.get_device_name() if torch.cuda.is_available() else None
if CARD is None:
    os.environ.setdefault("TRITON_INTERPRET", "1")

from unveil_core.base.kernels.device import GPU, working_on  # noqa: E402
from unveil_core.bench import gpu as on_gpu  # noqa: E402
from unveil_core.bench.compiled import CAPABILITIES, compiled  # noqa: E402
from unveil_core.bench.rivals import gsplat_is_there  # noqa: E402
from unveil_core.bench.scenes import corridor, corridor_camera  # noqa: E402
from unveil_core.bench.step import bench_step  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.raster.api import PLANES  # noqa: E402
from unveil_core.raster.triton.memory import step_bytes  # noqa: E402

RESULTS = ROOT / "benchmarks/results/gpu.json"
COUNTS = (100_000, 500_000, 2_000_000)
SIZES = ((480, 320), (960, 640), (1920, 1280))
PAPER = {"frames": 198, "size": (484, 320)}
"""Number and size of frames of the paper's scenes."""
TILES_EACH = 10
"""Tiles of a surfel in a scene of large surfels, such as a street that was trained out of doors."""


def kernels() -> list[dict[str, Any]]:
    """Registers, shared memory and spills of each kernel for each card."""
    return compiled(CAPABILITIES)


def count_bytes() -> list[dict[str, Any]]:
    """Bytes of a training step with 19 labels, in the corridor and where surfels are large."""
    rows = []
    for size in SIZES:
        camera = corridor_camera(*size)
        for count in (100_000, 1_000_000, 2_000_000):
            surfels = corridor(count)
            if CARD:
                boxes, reached = None, on_gpu.intersections(surfels.to("cuda"), camera)
            else:
                boxes, reached = on_gpu.reached_tiles(surfels, camera)
            for scene, pairs in (("corridor", reached), ("large surfels", TILES_EACH * count)):
                row = {"surfels": count, "size": size, "labels": 19, "scene": scene, "intersections": pairs}
                if scene == "corridor" and boxes is not None:
                    row["of_bounding_boxes"] = boxes
                for name, planes in (
                    ("all", PLANES),
                    ("all but label distortion", PLANES[:-1]),
                    ("rgb, alpha", PLANES[:2]),
                ):
                    row[name] = step_bytes(count, pairs, *size, 19, planes)
                rows.append(row)
    return rows


def checks() -> dict[str, Any]:
    """Every plane and gradient against float64: on a card a scene of full size, else a small one in the interpreter."""
    if CARD:
        size, count, tiles = (480, 320), 100_000, (155, 404)
    else:
        size, count, tiles = (32, 24), 120, None
    surfels, camera = corridor(count, degree=1), corridor_camera(*size)
    errors = on_gpu.backend_errors(surfels, camera, "cuda" if CARD else "cpu", tiles=tiles)
    on_cpu = on_gpu.backend_errors(surfels, camera, "cpu", backend="cpu", tiles=tiles)
    return {"surfels": count, "size": size, "triton": errors, "cpu": on_cpu}


def speed() -> dict[str, Any]:
    """Passes of all counts and sizes, and of the largest street the kernels one by one."""
    rows = []
    for size in SIZES:
        for count in COUNTS:
            rows.append(on_gpu.pass_times(count, size, rounds=10))
            print(json.dumps(rows[-1]), flush=True)
    one_by_one = {f"{count}": on_gpu.kernel_times(count, SIZES[-1]) for count in COUNTS[-2:]}
    by_warps = on_gpu.warp_times(500_000, SIZES[-1], rounds=10)
    return {
        "gsplat": gsplat_is_there(),
        "passes": rows,
        "kernels_at_1920x1280": one_by_one,
        "warps_of_500000_at_1920x1280": by_warps,
    }


def tests() -> dict[str, Any]:
    """The backend's tests on the card: every plane and gradient, the hard cases, all arrays against the CPU's."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", str(min(8, os.cpu_count() or 1))]
    command += ["tests/raster/triton", "tests/raster/test_hard_cases.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return {"exit_code": done.returncode, "last_lines": done.stdout.splitlines()[-20:]}


def step() -> list[dict[str, Any]]:
    """Training steps with all losses of the second stage, as a run takes them."""
    with working_on(GPU):
        return [bench_step(size=size, count=n, degree=0, iterations=30) for size in SIZES for n in COUNTS]


class CardMemory:
    """The most of the card's memory that is in use within a block, MB, by all programs: asked for ten times a second."""

    def __enter__(self) -> CardMemory:
        self.peak_mb, self._over = 0, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def _watch(self) -> None:
        while CARD and not self._over.wait(0.1):
            free, total = torch.cuda.mem_get_info()
            self.peak_mb = max(self.peak_mb, (total - free) >> 20)

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()


def whole_run(drive: Path, workspace: Path, *options: str) -> dict[str, Any]:
    """`unveil run`: seconds and memory, as a whole and by stage, and how good it is where the drive has a truth."""
    command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", str(workspace), *options]
    begun = time.perf_counter()
    with CardMemory() as memory:
        subprocess.run(command, check=True, cwd=ROOT, env={**os.environ, "OMP_WAIT_POLICY": "PASSIVE"})
    stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    row = {"options": options, "seconds": round(time.perf_counter() - begun, 1)}
    told = ("seconds", "peak_memory_mb")
    row |= {
        "card_memory_mb": memory.peak_mb,
        "stages": {n: {k: s[k] for k in told if k in s} for n, s in stages.items()},
    }
    metrics = workspace / "metrics.json"
    if metrics.is_file():
        found = json.loads(metrics.read_text())
        if "truth" in found:
            row["removed"] = found["truth"]["regions"]["removed"]["methods"]["ours"]
    return row


def sample() -> dict[str, Any]:
    """The sample street at two qualities on the card, and at `draft` on the processor beside it."""
    drive = ROOT / "sample_scenes" / "parked_street"
    with tempfile.TemporaryDirectory() as folder:
        return {
            f"{quality} on {device}": whole_run(
                drive, Path(folder) / f"{quality}_{device}", "--quality", quality, "--device", device
            )
            for quality, device in (("draft", "cuda"), ("draft", "cpu"), ("standard", "cuda"))
        }


def drive(cache: Path) -> dict[str, Any]:
    """A whole drive of the paper's number and size of frames."""
    from scale import drive_of

    footage = drive_of(PAPER["frames"], PAPER["size"], cache)
    with tempfile.TemporaryDirectory() as folder:
        options = ("--quality", "standard", "--remove", "vehicle", "--device", "cuda")
        return {**PAPER, **whole_run(footage, Path(folder) / "run", *options)}


def main() -> None:
    """Run the parts, and keep what they find."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--parts", default=None, help="of kernels,bytes,checks,tests,speed,step,sample,drive; all by default"
    )
    parser.add_argument("--cache", type=Path, default=None, help="for the drive that is made")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    anywhere: dict[str, Callable[[], Any]] = {"kernels": kernels, "bytes": count_bytes, "checks": checks}
    with tempfile.TemporaryDirectory() as folder:
        on_a_card = {"tests": tests, "speed": speed, "step": step, "sample": sample}
        on_a_card["drive"] = lambda: drive(arguments.cache or Path(folder))
        known = {**anywhere, **(on_a_card if CARD else {})}
        wanted = arguments.parts.split(",") if arguments.parts else list(known)
        for part in wanted:
            if part not in {**anywhere, **on_a_card}:
                parser.error(f"unknown part {part}; there are {', '.join({**anywhere, **on_a_card})}")
            if part not in known:
                parser.error(f"{part} needs an NVIDIA GPU that torch can use; torch sees none")
        if CARD is None:
            print(
                "torch sees no NVIDIA GPU: the kernels are compiled and run in Triton's interpreter; no speed is measured"
            )
        found: dict[str, Any] = {"machine": machine()}
        failed = []
        if CARD:
            facts = torch.cuda.get_device_properties(0)
            found["card"] = {"name": CARD, "memory_gb": round(facts.total_memory / 1e9, 1)}
            found["card"]["capability"], found["card"]["cuda"] = f"{facts.major}.{facts.minor}", torch.version.cuda
        else:
            found["speed"] = "not measured"
        for part in wanted:
            print(f"{part} ...", flush=True)
            begun = time.perf_counter()
            try:
                found[part] = known[part]()
            except Exception as error:  # what a card does not do is a result; the other parts are asked all the same
                traceback.print_exc()
                found[part] = {"failed": f"{type(error).__name__}: {error}"[:2000]}
                failed.append(part)
            print(f"{part}: {time.perf_counter() - begun:.0f} s", flush=True)
            keep(found, arguments.output)
    print(f"{CARD or 'no card'}: {', '.join(wanted)} in {arguments.output}")
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}")


def keep(found: dict[str, Any], output: Path) -> None:
    """Put what was found into the file, in the place of what it says of the same parts and card."""
    document = json.loads(output.read_text()) if output.is_file() else {}
    place = CARD or "no card"
    document[place] = {**document.get(place, {}), **found}
    output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
