"""What each stage costs, and what memory and disk a run takes, by the size of the work.

Each is a sum of a few sizes with weights from ``costs.json``, which ``benchmarks/machine/forecast.py`` fits to whole runs.
Times are of the machine that ran these; ``forecast.machine`` says what they are here.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from unveil_core.forecast.workload import Workload

__all__ = [
    "disk_mb",
    "disk_terms",
    "held_mb",
    "memory_terms",
    "peak_memory_mb",
    "reference_seconds",
    "seconds_of",
    "time_terms",
]

LONGEST_M = 150.0
"""Length of street that is read at once, metres: a block and its surroundings."""
PIXEL_BYTES = 34.0
"""That a frame takes in the cache for each of its pixels, with all that training asks of it: measured at 1920x1280."""


@cache
def _weights() -> dict[str, Any]:
    data: dict[str, Any] = json.loads((files(__package__) / "costs.json").read_text(encoding="utf-8"))
    return data


def time_terms(work: Workload) -> tuple[float, ...]:
    """1, frames, millions of pixels as worked on, and as they came where those are more."""
    return 1.0, float(work.frames), work.working_mpx, _larger(work)


def held_mb(work: Workload) -> float:
    """Of the room for frames, what they take."""
    return min(work.memory_mb, work.working_mpx * PIXEL_BYTES * 1e6 / 2**20)


def memory_terms(work: Workload) -> tuple[float, ...]:
    """1, length of street read at once, and millions of pixels of a frame as worked on and as it came, beside held frames.
    Longer drives take no more."""
    frame = 1.0 / work.frames
    return 1.0, min(work.way_m, LONGEST_M), work.working_mpx * frame, _larger(work) * frame


def disk_terms(work: Workload) -> tuple[float, ...]:
    """Blocks, frames, millions of pixels as worked on, and as they came where those are more."""
    return float(work.blocks), float(work.frames), work.working_mpx, _larger(work)


def _larger(work: Workload) -> float:
    """Millions of pixels as they came, where the frames are reduced; else 0."""
    return work.given_mpx if work.given_mpx > 1.01 * work.working_mpx else 0.0


def seconds_of(work: Workload) -> dict[str, float]:
    """Seconds of each stage, on the machine that the weights were measured on."""
    table = _weights()["seconds"][work.quality]
    return {name: _sum(weights, time_terms(work)) for name, weights in table.items()}


def peak_memory_mb(work: Workload) -> float:
    """Largest resident size of the process."""
    return held_mb(work) + _sum(_weights()["memory_mb"][work.quality], memory_terms(work))


def disk_mb(work: Workload) -> float:
    """Size of the workspace, with what its stages write while they run."""
    return _sum(_weights()["disk_mb"][work.quality], disk_terms(work))


def reference_seconds() -> float:
    """What ``machine.measured_seconds`` is on the machine that the weights were measured on."""
    return float(_weights()["reference_seconds"])


def _sum(weights: list[float], terms: tuple[float, ...]) -> float:
    return float(sum(w * t for w, t in zip(weights, terms, strict=True)))
