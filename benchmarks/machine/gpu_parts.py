"""The parts of gpu.py: each is asked with how large it is to be and with the time that is left, and gives what JSON can hold."""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from benchmarks.machine.scale import drive_of
from unveil_core.base.kernels.device import GPU, Device, working_on
from unveil_core.bench import gpu as on_gpu
from unveil_core.bench.compiled import CAPABILITIES, compiled
from unveil_core.bench.rivals import gsplat_is_there
from unveil_core.bench.scenes import corridor, corridor_camera
from unveil_core.bench.step import bench_step
from unveil_core.raster.api import PLANES
from unveil_core.raster.triton.memory import step_bytes

ROOT = Path(__file__).resolve().parents[2]
CARD = torch.cuda.get_device_name() if torch.cuda.is_available() else None
THERE = "cuda" if CARD else "cpu"
PAPER = {"frames": 198, "size": (484, 320)}
"""Number and size of frames of the paper's scenes."""
TILES_EACH = 10
"""Tiles of a surfel in a scene of large surfels, such as a street that was trained out of doors."""
PACKAGES = {
    **{name: name for name in ("torch", "triton", "numpy", "numba", "scipy", "cv2", "cv2.ximgproc", "cv2.xphoto")},
    **{
        name: name for name in ("trimesh", "fast_simplification", "OpenEXR", "psutil", "platformdirs", "rich", "jinja2")
    },
    "PIL": "pillow",
}
"""Modules that a whole run imports, and what to install for them where that has another name."""


@dataclass(frozen=True)
class Extent:
    """How large all is.

    Attributes:
        counts, sizes: surfels of the corridor and pixels of a picture; rounds: how often a pass is timed.
        checked: surfels, size and tiles (None = all) that are held against float64.
        capabilities: cards that kernels are compiled for, times ten; kernels: regular expression of those.
        frames, size: of the drive that is made; options: of whole runs beside quality and device.
    """

    counts: tuple[int, ...]
    sizes: tuple[tuple[int, int], ...]
    rounds: int
    checked: tuple[int, tuple[int, int], tuple[int, ...] | None]
    capabilities: tuple[int, ...]
    kernels: str
    frames: int
    size: tuple[int, int]
    options: tuple[str, ...] = ()


WHOLE = Extent(
    (100_000, 500_000, 2_000_000),
    ((480, 320), (960, 640), (1920, 1280)),
    10,
    (100_000, (480, 320), (155, 404)) if CARD else (120, (32, 24), None),
    tuple(CAPABILITIES),
    "",
    PAPER["frames"],  # type: ignore[arg-type]
    PAPER["size"],  # type: ignore[arg-type]
)
TINY = Extent(
    (4,),
    ((16, 16),),
    1,
    (12, (16, 16), None),
    (80,),
    "sum_rows",
    3,
    (32, 24),
    ("--until", "objects", "--frames", "0:3"),
)
"""All that a card is asked, so small that Triton's interpreter does it in seconds."""


class TimeLeft:
    """What is left of the seconds that all may take; None = as long as it takes."""

    def __init__(self, seconds: float | None) -> None:
        self._end = None if seconds is None else time.monotonic() + seconds

    def seconds(self) -> float:
        """How many are left, infinite without a limit."""
        return float("inf") if self._end is None else max(0.0, self._end - time.monotonic())

    def skips(self, needs: float) -> str:
        """Why something that takes about so many seconds is left out; empty = it fits."""
        left = self.seconds()
        return "" if needs <= left else f"left out: takes about {needs:.0f} s, {left:.0f} s are left"


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


def missing() -> list[str]:
    """Packages that a whole run needs and this Python lacks."""
    lacks = []
    for module, package in PACKAGES.items():
        inside, _, part = module.partition(".")
        try:
            found = importlib.import_module(inside)
        except ImportError:
            lacks.append(package)
            continue
        if part and not hasattr(found, part):
            lacks.append(f"opencv-contrib-python-headless ({module})")
    return lacks


def imports(extent: Extent, left: TimeLeft) -> dict[str, Any]:
    """What is there of the packages, and the kernels' modules imported."""
    begun = time.perf_counter()
    for name in ("unveil_core.raster.triton.backend", "unveil_core.raster.cpu.backend", "unveil_core.pipeline.run"):
        importlib.import_module(name)
    found = {"seconds": round(time.perf_counter() - begun, 1), "missing": missing()}
    return {**found, "cuda": torch.version.cuda, "gsplat": gsplat_is_there()}


def kernels(extent: Extent, left: TimeLeft) -> list[dict[str, Any]]:
    """Registers, shared memory and spills of each kernel for each card."""
    return compiled(extent.capabilities, extent.kernels)


def count_bytes(extent: Extent, left: TimeLeft) -> list[dict[str, Any]]:
    """Bytes of a training step with 19 labels, in the corridor and where surfels are large."""
    rows = []
    for size in extent.sizes:
        camera = corridor_camera(*size)
        for count in sorted({min(extent.counts), max(extent.counts) // 2, max(extent.counts)}):
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


def checks(extent: Extent, left: TimeLeft) -> dict[str, Any]:
    """Every plane and gradient against float64, of both backends."""
    count, size, tiles = extent.checked
    surfels, camera = corridor(count, degree=1), corridor_camera(*size)
    errors = on_gpu.backend_errors(surfels, camera, THERE, tiles=tiles)
    on_cpu = on_gpu.backend_errors(surfels, camera, "cpu", backend="cpu", tiles=tiles)
    return {"surfels": count, "size": size, "triton": errors, "cpu": on_cpu}


def _grid(extent: Extent) -> Iterator[tuple[tuple[int, int], int, float]]:
    """Sizes, counts, and about how many seconds the making of the scene and some rounds take."""
    for size in extent.sizes:
        for count in extent.counts:
            yield size, count, 3.0 + count / 2e5


def passes(extent: Extent, left: TimeLeft) -> list[dict[str, Any]]:
    """Times of passes of all counts and sizes, forward and backward, and the memory of one."""
    rows: list[dict[str, Any]] = []
    for size, count, needs in _grid(extent):
        if why := left.skips(needs):
            rows.append({"surfels": count, "size": size, "skipped": why})
        else:
            rows.append(on_gpu.pass_times(count, size, rounds=extent.rounds, device=THERE))
        print(json.dumps(rows[-1]), flush=True)
    return rows


def one_by_one(extent: Extent, left: TimeLeft) -> dict[str, Any]:
    """Of the largest pictures the kernels one by one, and a pass by the warps of a tile's program."""
    size, middle = extent.sizes[-1], extent.counts[len(extent.counts) // 2]
    return {
        "kernels": {f"{count}": on_gpu.kernel_times(count, size) for count in extent.counts[-2:]},
        "warps": on_gpu.warp_times(middle, size, rounds=extent.rounds),
    }


def tests(extent: Extent, left: TimeLeft) -> dict[str, Any]:
    """The backend's tests on the card: every plane and gradient, the hard cases, all arrays against the CPU's."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", str(min(8, os.cpu_count() or 1))]
    command += ["tests/raster/triton", "tests/raster/test_hard_cases.py"]
    seconds = None if left.seconds() == float("inf") else left.seconds()
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=seconds)
    return {"exit_code": done.returncode, "last_lines": done.stdout.splitlines()[-20:]}


def step(extent: Extent, left: TimeLeft) -> list[dict[str, Any]]:
    """Training steps with all losses of the second stage, as a run takes them."""
    rows: list[dict[str, Any]] = []
    with working_on(GPU if CARD else Device("cpu", "triton")):
        for size, count, needs in _grid(extent):
            why = left.skips(needs + 10.0)  # with the start of a second process
            of = {"size": size, "surfels": count}
            rows.append(
                {**of, "skipped": why}
                if why
                else bench_step(size=size, count=count, degree=0, iterations=30 if CARD else 1)
            )
    return rows


def whole_run(drive: Path, workspace: Path, options: Iterable[str], left: TimeLeft) -> dict[str, Any]:
    """`unveil run`: seconds and memory, as a whole and by stage, and how good it is where the drive has a truth.

    A run that takes more than the time that is left is ended; its stages up to there are told.
    """
    command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", str(workspace), *options]
    begun = time.perf_counter()
    row: dict[str, Any] = {"options": list(options)}
    with CardMemory() as memory, tempfile.TemporaryFile() as said:
        environment = {**os.environ, "OMP_WAIT_POLICY": "PASSIVE"}
        # A session of its own, so that all that it started ends with it.
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=said, start_new_session=True)
        try:
            code = process.wait(None if left.seconds() == float("inf") else left.seconds())
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            code, row["cut_off"] = 0, "the time was over"
        said.seek(0)
        if code:
            raise RuntimeError(f"unveil run ended with {code}: {said.read().decode(errors='replace')[-1000:]}")
    row["seconds"] = round(time.perf_counter() - begun, 1)
    record = workspace / "workspace.json"
    stages = json.loads(record.read_text()).get("stages", {}) if record.is_file() else {}
    told = ("seconds", "peak_memory_mb", "device")
    row["card_memory_mb"] = memory.peak_mb
    row["stages"] = {n: {k: s[k] for k in told if k in s} for n, s in stages.items()}
    metrics = workspace / "metrics.json"
    if metrics.is_file():
        found = json.loads(metrics.read_text())
        if "truth" in found:
            row["removed"] = found["truth"]["regions"]["removed"]["methods"]["ours"]
    return row


def sample(extent: Extent, left: TimeLeft, runs: Iterable[tuple[str, str, float]]) -> dict[str, Any]:
    """The sample street, once for each quality and device; with each about how many seconds it takes."""
    drive = ROOT / "sample_scenes" / "parked_street"
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for quality, device, needs in runs:
            workspace = Path(folder) / f"{quality}_{device}"
            options = ("--quality", quality, "--device", device if CARD else "cpu", *extent.options)
            why = left.skips(needs)
            found[f"{quality} on {device}"] = {"skipped": why} if why else whole_run(drive, workspace, options, left)
    return found


def long_drive(extent: Extent, left: TimeLeft, cache: Path) -> dict[str, Any]:
    """A whole drive of the paper's number and size of frames, which is made first."""
    begun = time.perf_counter()
    footage = drive_of(extent.frames, extent.size, cache)
    row = {"frames": extent.frames, "size": extent.size, "made_in_s": round(time.perf_counter() - begun, 1)}
    with tempfile.TemporaryDirectory() as folder:
        options = ("--quality", "standard", "--remove", "vehicle", "--device", THERE, *extent.options)
        return {**row, **whole_run(footage, Path(folder) / "run", options, left)}
