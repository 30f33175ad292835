"""Times taken side by side: one after the other, round by round, so that what disturbs one disturbs all."""

from __future__ import annotations

import gc
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import psutil

from unveil_core.base.surroundings.programs import program

__all__ = [
    "alternate",
    "core_seconds",
    "forget_peak_memory",
    "machine",
    "processor_seconds",
    "program_commit",
    "second_process_seconds",
]


def alternate(
    runs: Mapping[str, Callable[[], Any]], *, rounds: int, base: str | None = None
) -> dict[str, dict[str, float]]:
    """Time functions in alternation, after one round that does not count.

    Args:
        runs: by name; rounds: how often each; base: the name that ratios are taken to.
    Returns:
        by name: median and least milliseconds, and with a base the median of the ratios to it within each round.
    """
    times: dict[str, list[float]] = {name: [] for name in runs}
    # What is there already is no garbage of the runs: looking through it each time would take longer than small runs do.
    gc.collect()
    gc.freeze()
    try:
        for turn in range(rounds + 1):
            for name, run in runs.items():
                gc.collect()
                begun = time.perf_counter()
                run()
                if turn:
                    times[name].append((time.perf_counter() - begun) * 1e3)
    finally:
        gc.unfreeze()
    figures = {name: {"ms": statistics.median(t), "least_ms": min(t)} for name, t in times.items()}
    if base in times:
        for name, t in times.items():
            figures[name]["ratio"] = statistics.median(a / b for a, b in zip(t, times[base], strict=True))
    return {name: {k: round(v, 4) for k, v in row.items()} for name, row in figures.items()}


def machine() -> dict[str, Any]:
    """What the figures were taken on, and of which state of the program: ``commit`` as :func:`program_commit` has it, of the
    checkout that this is imported from."""
    processor = platform.processor()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        names = [
            line.split(":")[1].strip() for line in cpuinfo.read_text().splitlines() if line.startswith("model name")
        ]
        processor = names[0] if names else processor
    versions: dict[str, str | None] = {"python": platform.python_version()}
    for package in ("unveil-core", "torch", "numpy", "numba", "llvmlite", "triton"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "commit": program_commit(Path(__file__).resolve().parents[2]),
        "processor": processor,
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "load_before": load,
        "versions": versions,
    }


def program_commit(repository: Path) -> str | None:
    """The commit that figures are taken of, with a ``+`` where files that git knows differ from it; None outside of git.

    Results of benchmarks do not count as a difference: a script that writes one row after another makes it itself.
    """
    # Files of the repository's own that git would run are left alone.
    git = [
        program("git") or "git",
        "-C",
        str(repository),
        "-c",
        "core.fsmonitor=false",
        "-c",
        f"core.hooksPath={os.devnull}",
    ]
    try:
        commit = subprocess.run([*git, "rev-parse", "--short", "HEAD"], check=True, capture_output=True, text=True)
        asked = [*git, "status", "--porcelain", "--untracked-files=no", "--", ".", ":!benchmarks/results"]
        changed = subprocess.run(asked, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit.stdout.strip() + ("+" if changed.stdout.strip() else "")


def forget_peak_memory() -> None:
    """Count the peak anew from what is held now, where the system lets one (Linux); elsewhere it stays the process's."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


_FIRST_PASS = """
from unveil_core.base.surroundings.guarded_imports import own_this_process
own_this_process()
import torch
from unveil_core.bench.scenes import LABELS, corridor, corridor_camera
from unveil_core.raster.api import PLANES, render
surfels = corridor(1000, degree=3)
surfels.means.requires_grad_(True)
out = render(surfels, corridor_camera(96, 64), PLANES, label_count=LABELS)
sum(getattr(out, plane).sum() for plane in PLANES).backward()
"""


def second_process_seconds() -> float:
    """Seconds that a fresh process takes to its first whole pass, forward and backward, its kernels being cached."""
    for _ in range(2):
        begun = time.perf_counter()
        subprocess.run([sys.executable, "-P", "-c", _FIRST_PASS], check=True)
        took = time.perf_counter() - begun
    return round(took, 2)


def processor_seconds() -> float:
    """Seconds that all threads of this process, and of those that it started and that have ended, took so far: unlike the time on a
    clock they tell little of what else the machine does."""
    taken = os.times()
    return taken.user + taken.system + taken.children_user + taken.children_system


def core_seconds() -> list[float]:
    """Seconds that each core was busy since the machine started, for whomever."""
    return [core.user + core.system + getattr(core, "nice", 0.0) for core in psutil.cpu_times(percpu=True)]
